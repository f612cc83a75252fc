"""Figures of what arrives at the ego and of what links carry, as the page shows them."""

from __future__ import annotations

from typing import Any

from swarm.messages import Detections, LinkState


class Tally:
    """What arrived at the ego from `since` on, seconds on the steady clock."""

    def __init__(self, since: float) -> None:
        self.since = since
        self.frames = 0
        self._latency_ms = 0.0
        self._bytes: dict[str, int] = {}

    def add(self, detections: Detections) -> None:
        """Counts one fused frame."""
        self.frames += 1
        self._latency_ms += detections.latency_ms
        for robot, count in detections.bytes.items():
            self._bytes[robot] = self._bytes.get(robot, 0) + count

    def rates(self, now: float) -> dict[str, Any]:
        """bit/s by robot, and fused frames a second."""
        span_s = max(now - self.since, 1e-3)
        return {
            "bps": {robot: round(8 * n / span_s) for robot, n in self._bytes.items()},
            "frames_per_s": round(self.frames / span_s, 1),
        }

    def figures(self, now: float) -> dict[str, Any]:
        """bit/s of all and mean latency; None where no frame came."""
        if not self.frames:
            return {"used_bps": None, "latency_ms": None}
        used = 8 * sum(self._bytes.values()) / max(now - self.since, 1e-3)
        latency_ms = self._latency_ms / self.frames
        return {"used_bps": round(used), "latency_ms": round(latency_ms, 1)}


def link_figures(link: LinkState) -> dict[str, Any]:
    """One link: rates in bit/s, of all its classes together."""
    return {
        "robot": link.robot,
        "direction": link.direction,
        "capacity_bps": link.capacity_bps,
        "available_bps": link.available_bps,
        "used_bps": sum(one.throughput_bps for one in link.classes.values()),
        "latency_ms": round(link.latency_ms, 1),
        "level": link.level,
        "drops": sum(one.drops for one in link.classes.values()),
    }
