"""What was before a page was opened, from Prometheus: a few fixed questions over a few spans."""

from __future__ import annotations

import asyncio
import math
import time
from typing import Any

import msgspec

from options.console.answers import Step
from options.console.prometheus import Prometheus

STEPS_S = {120: 2, 900: 5, 3600: 15, 21600: 60}
"""Spans that may be asked for, seconds, and the steps that they are told in."""
WINDOW_S = 15
"""Rates are means over so long at least: an ego may decide every five seconds."""
_KINDS = ("algorithm", "source")


class Past:
    """Answers for all pages: each span is asked for once a step."""

    def __init__(self, server: Prometheus, ego: str) -> None:
        self._server = server
        self._ego = ego
        self._told: dict[int, tuple[float, asyncio.Task[tuple[Step, ...]]]] = {}

    async def rows(self, span_s: int) -> tuple[Step, ...]:
        """What was decided and used, a row a step; steps without a decision are left out.

        Raises TransportError where Prometheus does not answer, or not as Prometheus does.
        """
        now = time.monotonic()
        begun_at, task = self._told.get(span_s, (-math.inf, None))
        if task is None or now - begun_at > STEPS_S[span_s]:
            task = asyncio.create_task(asyncio.to_thread(self._ask, span_s))
            self._told[span_s] = now, task
            task.add_done_callback(lambda done: self._forget_failed(span_s, done))
        # A page that goes away does not take the answer from the others.
        return await asyncio.shield(task)

    def _forget_failed(self, span_s: int, done: asyncio.Task[tuple[Step, ...]]) -> None:
        """So that whoever asks next has Prometheus asked again."""
        if (done.cancelled() or done.exception()) and self._told[span_s][1] is done:
            del self._told[span_s]

    def _ask(self, span_s: int) -> tuple[Step, ...]:
        step_s = STEPS_S[span_s]
        # On whole steps, so that rows stand still while new ones come.
        end_s = time.time() // step_s * step_s
        rows: dict[float, dict[str, Any]] = {}
        for name, expression in _expressions(self._ego, max(WINDOW_S, 2 * step_s)).items():
            best: dict[float, float] = {}
            for labels, samples in self._server.range(expression, end_s - span_s, end_s, step_s):
                for at, value in samples:
                    row = rows.setdefault(at, {"at": at})
                    if not math.isfinite(value):
                        continue
                    if name not in _KINDS:
                        row[name] = round(value, 1)
                    elif value > best.get(at, 0.0):
                        best[at] = value
                        row[name] = labels.get(name)
        names = [*_expressions(self._ego, WINDOW_S)]
        return tuple(
            msgspec.convert(dict.fromkeys(names) | row, Step)
            for _, row in sorted(rows.items())
            if "robots" in row and "capacity_bps" in row
        )


def _expressions(ego: str, window_s: int) -> dict[str, str]:
    """PromQL by what it tells; of `_KINDS` the series with the highest value counts."""
    of = f'{{instance="ego-{ego}"}}'
    window = f"{of}[{window_s}s]"
    return {
        "capacity_bps": f"max(coadapt_ego_capacity_bps{of})",
        "robots": f"max(coadapt_ego_participants{of})",
        "used_bps": f"8 * sum(rate(coadapt_ego_received_bytes_total{window}))",
        "latency_ms": "1000 * histogram_quantile(0.5, "
        f"sum by (le) (rate(coadapt_ego_frame_seconds_bucket{window})))",
        "algorithm": f"sum by (algorithm) (rate(coadapt_ego_decisions_total{window})) > 0",
        "source": f"sum by (source) (rate(coadapt_ego_decisions_total{window})) > 0",
    }
