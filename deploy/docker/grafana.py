"""Grafana as a container of the swarm: the project's dashboards, for whoever reaches the host's
loopback.

It holds nothing: dashboards and data source are files of the repository, mounted read-only.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Any

from deploy.dashboards import GRAFANA
from deploy.docker.image import Say, exists, pull
from deploy.ports import LOCALHOST
from deploy.roster import PROMETHEUS_PORT
from deploy.spec import SwarmSpec
from swarm.errors import DeployError

IMAGE = (
    "grafana/grafana:12.3.1@sha256:2175aaa91c96733d86d31cf270d5310b278654b03f5718c59de12a865380a31f"
)
PORT = 3000
PASSWORD_FILE = "grafana-password"
"""The admin's, in the run directory."""
_FOLDER, _PASSWORD = "/etc/coadapt/grafana", "/run/secrets/grafana-password"
_SETTINGS = {
    "GF_AUTH_ANONYMOUS_ENABLED": "true",
    "GF_AUTH_ANONYMOUS_ORG_ROLE": "Viewer",
    "GF_SECURITY_ADMIN_PASSWORD__FILE": _PASSWORD,
    "GF_USERS_ALLOW_SIGN_UP": "false",
    "GF_PATHS_PROVISIONING": f"{_FOLDER}/provisioning",
    "GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH": f"{_FOLDER}/swarm.json",
    "COADAPT_DASHBOARDS": _FOLDER,
    "COADAPT_PROMETHEUS_URL": f"http://prometheus:{PROMETHEUS_PORT}",
    # A site without a network: nothing asks for news, updates, pictures or plugins.
    "GF_ANALYTICS_REPORTING_ENABLED": "false",
    "GF_ANALYTICS_CHECK_FOR_UPDATES": "false",
    "GF_ANALYTICS_CHECK_FOR_PLUGIN_UPDATES": "false",
    "GF_ANALYTICS_FEEDBACK_LINKS_ENABLED": "false",
    "GF_NEWS_NEWS_FEED_ENABLED": "false",
    "GF_PLUGINS_PREINSTALL_DISABLED": "true",
    "GF_SECURITY_DISABLE_GRAVATAR": "true",
    "GF_SNAPSHOTS_EXTERNAL_ENABLED": "false",
}


def image() -> str:
    """COADAPT_GRAFANA_IMAGE, else the official one."""
    return os.environ.get("COADAPT_GRAFANA_IMAGE") or IMAGE


def ensure_image(say: Say) -> None:
    """Pulls the image where the engine does not have it. Raises DeployError that says how else it
    gets there."""
    if exists(image()):
        return
    say(f"pulling {image()}")
    trouble = pull(image())
    if trouble:
        raise DeployError(
            f"Grafana's image {image()} cannot be pulled: {trouble}; set COADAPT_GRAFANA_IMAGE "
            "to a copy of it (what `docker load` brings has a name and no digest), or start "
            "without --grafana"
        )


def write_password(run_dir: Path) -> None:
    """Makes a password for Grafana's admin, which only this user can read."""
    path = run_dir / PASSWORD_FILE
    path.touch(mode=0o600)
    path.write_text(secrets.token_urlsafe(24))


def container(spec: SwarmSpec) -> dict[str, Any]:
    """What its container has other than the swarm's own."""
    return {
        "image": image(),
        "environment": dict(_SETTINGS),
        # It keeps its database beside its program.
        "read_only": False,
        "volumes": [
            f"{GRAFANA}:{_FOLDER}:ro",
            f"{spec.run_dir}/{PASSWORD_FILE}:{_PASSWORD}:ro",
        ],
        "ports": [f"{LOCALHOST}:{spec.grafana_port}:{PORT}"],
        "depends_on": ["prometheus"],
    }
