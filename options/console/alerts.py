"""The alerts that fire, put on the board while somebody looks."""

from __future__ import annotations

import asyncio

from options.console.board import now_s
from options.console.prometheus import Prometheus
from options.console.seats import Seats
from swarm.errors import TransportError

PERIOD_S = 5.0
"""Prometheus evaluates its rules no more often."""


async def watch_alerts(server: Prometheus, seats: Seats) -> None:
    """Puts `alerts` on all boards until cancelled: when they were asked for, `firing`, and why
    nobody knows (`error`), else empty."""
    while True:
        if seats.viewers:
            try:
                firing, error = await asyncio.to_thread(server.alerts), ""
            except TransportError as failed:
                firing, error = [], str(failed)
            for seat in seats.taken:
                seat.board.put("alerts", {"at": now_s(), "firing": firing, "error": error})
        await asyncio.sleep(PERIOD_S if seats.viewers else 1.0)
