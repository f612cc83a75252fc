"""Questions to the swarm's Prometheus, over its own HTTP API."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from swarm.errors import DeployError, TransportError
from swarm.http.asking import ask

TIMEOUT_S = 5.0
MAX_BYTES = 16_000_000
"""The longest answer that is read."""


@dataclass(frozen=True, slots=True)
class Target:
    """One process that Prometheus scrapes."""

    job: str
    instance: str
    health: str
    """`up`, `down` or `unknown` (not scraped yet)."""
    error: str


@dataclass(frozen=True, slots=True)
class Sample:
    """One value of an instant query."""

    labels: dict[str, str]
    value: float


@dataclass(frozen=True, slots=True)
class Alert:
    """One alert that fires."""

    name: str
    severity: str
    summary: str
    description: str


class Prometheus:
    """The server at a base URL, such as http://127.0.0.1:9090."""

    def __init__(self, url: str) -> None:
        self._url = url

    def targets(self) -> tuple[Target, ...]:
        """All targets that it is configured to scrape. Raises DeployError when it does not
        answer."""
        found = self._get("targets", {"state": "active"})["activeTargets"]
        return tuple(
            Target(
                job=t["labels"]["job"],
                instance=t["labels"]["instance"],
                health=t["health"],
                error=t["lastError"],
            )
            for t in found
        )

    def query(self, expression: str) -> tuple[Sample, ...]:
        """The values of a PromQL expression now. Raises DeployError when it does not answer or
        refuses the expression."""
        found = self._get("query", {"query": expression})["result"]
        return tuple(Sample(labels=s["metric"], value=float(s["value"][1])) for s in found)

    def alerts(self) -> tuple[Alert, ...]:
        """The alerts that fire. Raises DeployError when it does not answer."""
        return tuple(
            Alert(
                name=a["labels"]["alertname"],
                severity=a["labels"].get("severity", ""),
                summary=a["annotations"].get("summary", ""),
                description=a["annotations"].get("description", ""),
            )
            for a in self._get("alerts", {})["alerts"]
            if a["state"] == "firing"
        )

    def _get(self, path: str, parameters: dict[str, str]) -> Any:
        target = f"/api/v1/{path}?{urlencode(parameters)}"
        try:
            status, raw = ask(
                self._url.rstrip("/") + target, timeout_s=TIMEOUT_S, most_bytes=MAX_BYTES
            )
            if status == 200:
                return json.loads(raw)["data"]
        except (TransportError, ValueError, KeyError) as error:
            raise DeployError(f"Prometheus at {self._url} does not answer: {error}") from error
        words = raw[:500].decode(errors="replace")
        raise DeployError(f"Prometheus refused {self._url}{target}: {words}")
