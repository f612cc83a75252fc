"""Questions to the swarm's Prometheus, which has seen what no page was open for."""

from __future__ import annotations

import json
from contextlib import closing
from http.client import HTTPConnection, HTTPException
from typing import Any
from urllib.parse import urlencode, urlsplit

from swarm.errors import TransportError

TIMEOUT_S = 5.0
MAX_BYTES = 4_000_000
"""The longest answer that is read."""


class Prometheus:
    """The server at a base URL, such as http://127.0.0.1:9090. Blocks: ask it on a thread."""

    def __init__(self, url: str) -> None:
        self.url = url

    def range(
        self, expression: str, start_s: float, end_s: float, step_s: float
    ) -> list[tuple[dict[str, str], list[tuple[float, float]]]]:
        """The series of an expression: labels, and (seconds since the epoch, value) for each step.

        Raises TransportError where it does not answer, or refuses the expression.
        """
        asked = {"query": expression, "start": start_s, "end": end_s, "step": step_s}
        found = self._get("query_range", asked)["result"]
        return [
            (one["metric"], [(float(at), float(value)) for at, value in one["values"]])
            for one in found
        ]

    def alerts(self) -> list[dict[str, str]]:
        """The alerts that fire: name, severity, summary, description, since (RFC 3339).

        Raises TransportError where it does not answer.
        """
        return [
            {
                "name": one["labels"]["alertname"],
                "severity": one["labels"].get("severity", ""),
                "summary": one["annotations"].get("summary", ""),
                "description": one["annotations"].get("description", ""),
                "since": one["activeAt"],
            }
            for one in self._get("alerts", {})["alerts"]
            if one["state"] == "firing"
        ]

    def _get(self, path: str, parameters: dict[str, Any]) -> Any:
        try:
            # Unlike urllib, it asks no proxy of the environment for what runs here.
            host = urlsplit(self.url).netloc
            with closing(HTTPConnection(host, timeout=TIMEOUT_S)) as connection:
                connection.request("GET", f"/api/v1/{path}?{urlencode(parameters)}")
                reply = connection.getresponse()
                raw = reply.read(MAX_BYTES)
            if reply.status == 200:
                return json.loads(raw)["data"]
        except (OSError, HTTPException, ValueError, KeyError) as error:
            raise TransportError(f"Prometheus at {self.url} does not answer: {error}") from error
        raise TransportError(
            f"Prometheus at {self.url} answers with status {reply.status}: "
            f"{raw[:200].decode(errors='replace')}"
        )
