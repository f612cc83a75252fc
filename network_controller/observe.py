"""From counters to states: what went through the links in the last second, and what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping

from network_controller import ladder
from network_controller.fairness import max_min
from network_controller.metrics import ControllerMetrics
from network_controller.model import ClassReading, Link, LinkReading
from network_controller.slow_loop import Load
from swarm.messages import Backlog, ClassName, LinkClass, LinkState
from swarm.traffic import TrafficClass

CLASS_NAMES: Mapping[TrafficClass, ClassName] = {
    TrafficClass.CONTROL: "control",
    TrafficClass.FUSION: "fusion",
    TrafficClass.BACKGROUND: "background",
}
SMOOTHING = 0.5
"""Weight of the last second; a rise counts at once, so that no ego plans with what is taken."""

IDLE = 0.1
"""A link that carries less than this part of its guarantee is idle: beacons alone."""


class Observer:
    """Keeps the counters of the last look at each link. Times are `time.monotonic()` seconds."""

    def __init__(self, metrics: ControllerMetrics) -> None:
        self._metrics = metrics
        self._before: dict[Link, tuple[float, LinkReading]] = {}
        self._throughput: dict[tuple[Link, TrafficClass], float] = {}
        self._smooth: dict[tuple[Link, TrafficClass], float] = {}

    def look(
        self,
        readings: Mapping[Link, LinkReading],
        backlogs: Mapping[Link, Mapping[TrafficClass, Backlog]],
        now_s: float,
        *,
        between: bool = False,
    ) -> Mapping[Link, Mapping[TrafficClass, LinkClass]]:
        """The classes of all links since the last look; the first look has no throughput.
        `between` two looks throughputs stay: over so short a time they would be a burst's."""
        seen = {}
        self._before = {link: self._before[link] for link in self._before if link in readings}
        for link, reading in readings.items():
            at, before = self._before.get(link, (now_s, reading))
            if not between or link not in self._before:
                self._before[link] = (now_s, reading)
                for traffic, now in reading.classes.items():
                    self._count(link, traffic, now, before.classes.get(traffic), now_s - at)
            told = backlogs.get(link, {})
            seen[link] = {
                traffic: self._class(link, traffic, now, told.get(traffic, Backlog()))
                for traffic, now in reading.classes.items()
            }
        self._smooth = {k: bps for k, bps in self._smooth.items() if k[0] in readings}
        self._throughput = {k: bps for k, bps in self._throughput.items() if k[0] in readings}
        return seen

    def _count(
        self,
        link: Link,
        traffic: TrafficClass,
        now: ClassReading,
        before: ClassReading | None,
        elapsed_s: float,
    ) -> None:
        if before is None or before.sent_bytes > now.sent_bytes:
            before = now  # a new class: its counters began anew
        sent = now.sent_bytes - before.sent_bytes
        throughput_bps = 8.0 * sent / elapsed_s if elapsed_s > 0.0 else 0.0
        labels = (link.robot, link.direction, CLASS_NAMES[traffic])
        self._metrics.sent.labels(*labels).inc(sent)
        self._metrics.drops.labels(*labels).inc(max(0, now.drops - before.drops))
        self._metrics.overlimits.labels(*labels).inc(max(0, now.overlimits - before.overlimits))
        old_bps = self._smooth.get((link, traffic), throughput_bps)
        self._smooth[link, traffic] = max(
            throughput_bps, old_bps + SMOOTHING * (throughput_bps - old_bps)
        )
        self._throughput[link, traffic] = throughput_bps

    def _class(
        self, link: Link, traffic: TrafficClass, now: ClassReading, backlog: Backlog
    ) -> LinkClass:
        return LinkClass(
            rate_bps=now.shape.rate_bps,
            ceil_bps=now.shape.ceil_bps,
            priority=now.shape.priority,
            throughput_bps=round(self._throughput.get((link, traffic), 0.0)),
            sent_bytes=now.sent_bytes,
            backlog_bytes=now.backlog_bytes,
            drops=now.drops,
            overlimits=now.overlimits,
            backlog=backlog,
        )

    def load(self, link: Link, reading: LinkReading) -> Load:
        """What the other classes take of a link, after `look`."""
        background = reading.classes.get(TrafficClass.BACKGROUND)
        throughput_bps = self._smooth.get((link, TrafficClass.BACKGROUND), 0.0)
        waiting = background is not None and _waiting_bytes(background, reading, throughput_bps) > 0
        return Load(
            capacity_bps=reading.capacity_bps,
            control_bps=self._smooth.get((link, TrafficClass.CONTROL), 0.0),
            background_bps=math.inf if waiting else throughput_bps,
        )

    def busy(self, link: Link, reading: LinkReading) -> bool:
        """Whether anybody uses a link, after `look`."""
        throughput_bps = sum(self._smooth.get((link, traffic), 0.0) for traffic in reading.classes)
        waiting = any(one.backlog_bytes > 0 for one in reading.classes.values())
        return waiting or throughput_bps > IDLE * reading.capacity_bps


def _waiting_bytes(cls: ClassReading, reading: LinkReading, throughput_bps: float) -> float:
    """What waits for the link. netem's backlog also holds what is under way: the throughput times
    the delay, give or take half as much again for bursts."""
    under_way_bytes = 1.5 * throughput_bps * reading.delay_ms / 8e3
    return max(0.0, cls.backlog_bytes - under_way_bytes)


def link_state(
    link: Link,
    reading: LinkReading,
    classes: Mapping[TrafficClass, LinkClass],
    load: Load,
    level: int,
    egos: Mapping[str, float],
) -> LinkState:
    """What is published of a link; `egos` are those that share it, with what each needs in
    bit/s."""
    available_bps = ladder.available_bps(
        reading.capacity_bps, level, load.control_bps, load.background_bps
    )
    fusion, seen = reading.classes.get(TrafficClass.FUSION), classes.get(TrafficClass.FUSION)
    waiting_bits = 0.0
    if fusion is not None and seen is not None:
        waiting_bits = 8.0 * _waiting_bytes(fusion, reading, seen.throughput_bps)
    grants = max_min(available_bps, egos) if len(egos) > 1 else {}
    return LinkState(
        robot=link.robot,
        direction=link.direction,
        capacity_bps=reading.capacity_bps,
        available_bps=available_bps,
        latency_ms=reading.delay_ms + 1e3 * waiting_bits / max(1, available_bps),
        level=level,
        classes={CLASS_NAMES[traffic]: cls for traffic, cls in classes.items()},
        grants={ego: int(bps) for ego, bps in grants.items()},
    )
