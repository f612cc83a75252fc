"""The alerts that fire, put on the board while somebody looks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from options.console.board import Board, now_s
from options.console.prometheus import Prometheus
from swarm.errors import TransportError

PERIOD_S = 5.0
"""Prometheus evaluates its rules no more often."""


async def watch_alerts(server: Prometheus, board: Board, looked_at: Callable[[], bool]) -> None:
    """Puts `alerts` on the board until cancelled: when they were asked for, `firing`, and why
    nobody knows (`error`), else empty."""
    while True:
        if looked_at():
            try:
                firing, error = await asyncio.to_thread(server.alerts), ""
            except TransportError as failed:
                firing, error = [], str(failed)
            board.put("alerts", {"at": now_s(), "firing": firing, "error": error})
        await asyncio.sleep(PERIOD_S if looked_at() else 1.0)
