"""What operators look at: alert rules for Prometheus, dashboards and provisioning for Grafana."""

from __future__ import annotations

from pathlib import Path

ALERTS = Path(__file__).with_name("alerts.yml")
GRAFANA = Path(__file__).with_name("grafana")
"""Dashboards (JSON), and below `provisioning/` how Grafana finds them and Prometheus."""
