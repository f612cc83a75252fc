"""Questions to the swarm's Prometheus, which has seen what no page was open for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar
from urllib.parse import urlencode

import msgspec

from swarm.errors import TransportError
from swarm.http.asking import ask

TIMEOUT_S = 5.0
MAX_BYTES = 4_000_000
"""The longest answer that is read."""
T = TypeVar("T")


class _Answer(msgspec.Struct):
    """What is read of Prometheus' HTTP API; other fields are let through."""

    data: Any


class _Series(msgspec.Struct):
    metric: dict[str, str]
    values: list[tuple[float, str]]


class _Matrix(msgspec.Struct):
    result: list[_Series]


class _Alert(msgspec.Struct, rename="camel"):
    state: str
    active_at: str
    labels: dict[str, str]
    annotations: dict[str, str]


class _Alerts(msgspec.Struct):
    alerts: list[_Alert]


class Prometheus:
    """The server at a base URL, such as http://127.0.0.1:9090. Blocks: ask it on a thread."""

    def __init__(self, url: str) -> None:
        self.url = url

    def range(
        self, expression: str, start_s: float, end_s: float, step_s: float
    ) -> list[tuple[dict[str, str], list[tuple[float, float]]]]:
        """The series of an expression: labels, and (seconds since the epoch, value) for each step.

        Raises TransportError where it does not answer, or not as Prometheus does, or refuses the
        expression.
        """
        asked = {"query": expression, "start": start_s, "end": end_s, "step": step_s}
        found = self._get("query_range", asked, _Matrix)
        # Values are text, for infinities and what is no number.
        with self._shape_checked():
            return [
                (one.metric, [(at, float(value)) for at, value in one.values])
                for one in found.result
            ]

    def alerts(self) -> list[dict[str, str]]:
        """The alerts that fire: name, severity, summary, description, since (RFC 3339).

        Raises TransportError where it does not answer, or not as Prometheus does.
        """
        return [
            {
                "name": one.labels.get("alertname", ""),
                "severity": one.labels.get("severity", ""),
                "summary": one.annotations.get("summary", ""),
                "description": one.annotations.get("description", ""),
                "since": one.active_at,
            }
            for one in self._get("alerts", {}, _Alerts).alerts
            if one.state == "firing"
        ]

    def _get(self, path: str, parameters: dict[str, Any], shape: type[T]) -> T:
        target = f"{self.url.rstrip('/')}/api/v1/{path}?{urlencode(parameters)}"
        try:
            status, raw = ask(target, timeout_s=TIMEOUT_S, most_bytes=MAX_BYTES)
        except TransportError as error:
            raise TransportError(f"Prometheus at {self.url} does not answer: {error}") from error
        if status != 200:
            raise TransportError(
                f"Prometheus at {self.url} answers with status {status}: "
                f"{raw[:200].decode(errors='replace')}"
            )
        with self._shape_checked():
            return msgspec.convert(msgspec.json.decode(raw, type=_Answer).data, shape)

    @contextmanager
    def _shape_checked(self) -> Iterator[None]:
        try:
            yield
        # ValueError: also what msgspec raises for another shape, and text that is no number.
        except (ValueError, RecursionError) as error:
            raise TransportError(
                f"{self.url} does not answer as Prometheus does: {error}"
            ) from error
