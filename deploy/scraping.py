"""What Prometheus scrapes of a swarm."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import yaml

from deploy.roster import Service
from swarm.trust.serving import SERVER_NAME

SCRAPE_S = 2
EVALUATE_S = 5
"""How often Prometheus looks whether an alert fires."""
OVER_TLS = ("router", "controller", "gateway", "robot", "ego", "console")
"""Roles that serve metrics over TLS where a swarm's do."""
REFRESH_S = 10
"""How often it reads the file of targets again where it is not told that it has changed."""


def prometheus_config(
    members: Iterable[Service],
    address: Callable[[Service], str],
    alerts: str,
    targets: str = "",
    *,
    ca: str = "",
    tls: bool = False,
) -> str:
    """Prometheus' configuration (YAML): every service that serves metrics, one job a role, and
    those that joined later, as `Place.targets` tells.

    `address` gives the name or IP address at which Prometheus reaches a service, `alerts` the path
    of `deploy.dashboards.ALERTS` as Prometheus sees it. Targets carry the labels `role`, `robot`
    (of robots and egos) and `instance`, the service's name. `ca`: the certificate of a secure
    swarm's authority, as Prometheus sees it, for those that serve over TLS: with `tls`, all that
    have a certificate; else only such as joined and say so.
    """
    jobs: dict[str, list[dict[str, Any]]] = {}
    for service in members:
        if service.metrics_port is None:
            continue
        labels = {"role": service.role, "instance": service.name}
        if service.robot:
            labels["robot"] = service.robot
        target = f"{address(service)}:{service.metrics_port}"
        jobs.setdefault(service.role, []).append({"targets": [target], "labels": labels})
    # A robot process and the ego name robots in their own metrics: those labels count.
    trusting: dict[str, object] = (
        {"tls_config": {"ca_file": ca, "server_name": SERVER_NAME}} if ca else {}
    )
    scraped: list[dict[str, object]] = [
        {
            "job_name": role,
            "honor_labels": True,
            **({"scheme": "https", **trusting} if tls and role in OVER_TLS else {}),
            "static_configs": group,
        }
        for role, group in jobs.items()
    ]
    config = {
        "global": {
            "scrape_interval": f"{SCRAPE_S}s",
            "scrape_timeout": f"{SCRAPE_S}s",
            "evaluation_interval": f"{EVALUATE_S}s",
        },
        "rule_files": [alerts],
        "scrape_configs": scraped,
    }
    if targets:
        own = "|".join(
            re.escape(one["labels"]["instance"]) for group in jobs.values() for one in group
        )
        joined = {
            "job_name": "joined",
            "honor_labels": True,
            **trusting,
            "file_sd_configs": [{"files": [targets], "refresh_interval": f"{REFRESH_S}s"}],
            # What was started with the swarm is missed when it does not answer.
            "relabel_configs": [
                {"source_labels": ["instance"], "regex": own, "action": "drop"},
            ],
        }
        config["scrape_configs"] = [*scraped, joined]
    text: str = yaml.safe_dump(config, sort_keys=False)
    return text
