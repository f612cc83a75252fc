"""C(t): how many bits a second the ego's link delivers, and each robot's own link.

In the manner of BBR (Cardwell et al., "BBR: Congestion-Based Congestion Control", ACM Queue 14-5,
2016) what did not fill a link cannot lower its estimate. The kernel says what did: its queue stood
(`evidence.py`). How long an answer took in user space says nothing of the link, and is not asked.

- A link is measured by the queue of the socket that sends over it: the router's towards the ego
  (`net/tcp`), a robot's own towards the router.
- Where the shaper's queue stood (`net/state`), the link that it shapes is the limit, and carries
  what was configured: a socket behind it shows only the share that it got beside others.
- Without evidence that a link was filled, an estimate rises in the manner of CUBIC's window (RFC
  9438): for a while it hardly leaves what was measured, then ever faster, to twice that after
  `DOUBLING_S`; the cell's towards the prior, a robot's until it is no narrower than the cell. A
  link that has recovered is found out without traffic for its own sake.
- When nothing at all comes from anybody any more, each frame takes the cell's down by
  `SILENCE_DECAY`.

The prior of the cell is what the network controller last said that fusion can have (`net/state`),
else the setting; a robot's link counts as wide as the cell until something shows the contrary. No
estimate exceeds a fresh `net/state`.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from typing import NamedTuple

from ego_agent.monitor.evidence import FLOOR_BPS, MAX_QUEUES, Sample

SILENCE_DECAY = 0.85
DOUBLING_S = 5.0
STATE_FRESH_S = 5.0
"""`net/state` comes at 1 Hz; after this silence it is only a prior. A measured rate counts as the
present one for as long."""
NEW_LINK = 1.25
"""A link whose configured rate has moved by this factor, up or down, is another link: what was
measured on the old one is forgotten. Less is telemetry that comes and goes."""
OLD_LINK_S = 0.25
"""How late word may come of what was on its way over the old link."""


class _Filter:
    """The measured rate of one link; None until the link was the limit."""

    def __init__(self, since_s: float = -math.inf) -> None:
        """`since_s`: what was on its way before does not count."""
        self._since_s = since_s
        self.measured: tuple[float, float] | None = None
        """bit/s and when."""

    def add(self, sample: Sample, now_s: float) -> None:
        """Takes what a queue shows."""
        if now_s - sample.span_s < self._since_s:
            return
        if sample.filled or (self.measured is not None and sample.rate_bps > self.risen(now_s)):
            self.measured = (sample.rate_bps, now_s)

    def risen(self, now_s: float) -> float:
        """bit/s that are worth a try by now; infinite where nothing was measured."""
        if self.measured is None:
            return math.inf
        rate_bps, at = self.measured
        return rate_bps * (1.0 + (max(0.0, now_s - at) / DOUBLING_S) ** 3)


class _Uplink(NamedTuple):
    """What `net/state` says of a robot's link upwards."""

    available_bps: float
    reference_bps: float
    """What it said when the measurements of now began."""
    at_s: float


class LinkEstimate:
    """Thread-safe estimate of C(t). Times are `time.monotonic()` seconds, given by the caller."""

    def __init__(self, prior_bps: float) -> None:
        self._lock = threading.Lock()
        self._setting_bps = prior_bps
        self._prior_bps = prior_bps
        self._state_at: float | None = None
        self._reference_bps = prior_bps
        """The prior when the measurements of now began."""
        self._cell = _Filter()
        self._shown: tuple[float, float] | None = None
        """bit/s that the cell's queue showed last, and when."""
        self._robots: OrderedDict[str, _Filter] = OrderedDict()
        self._uplinks: dict[str, _Uplink] = {}

    def add_cell(self, sample: Sample, now_s: float) -> None:
        """Takes what a queue towards the ego shows."""
        with self._lock:
            if sample.filled:
                self._shown = (sample.rate_bps, now_s)
            self._cell.add(sample, now_s)

    def add_robot(self, robot: str, sample: Sample, now_s: float) -> None:
        """Takes what a queue from a robot shows."""
        with self._lock:
            self._keep(robot, self._robots.get(robot) or _Filter()).add(sample, now_s)

    def silence(self, now_s: float) -> None:
        """Takes a frame into the estimate in whose time nothing has come, nor for long before."""
        with self._lock:
            current_bps, _ = self._capacity(now_s)
            self._cell.measured = (max(FLOOR_BPS, current_bps * SILENCE_DECAY), now_s)

    def set_state(self, available_bps: float, now_s: float, *, stood: bool = False) -> None:
        """Takes the network controller's word for what fusion can have of the cell, and whether
        its queue there has stood."""
        with self._lock:
            available_bps = max(FLOOR_BPS, available_bps)
            if self._state_at is None or _another(available_bps, self._reference_bps):
                self._forget(available_bps, now_s)
            elif stood:
                self._cell = _Filter(now_s)
            self._prior_bps = available_bps
            self._state_at = now_s

    def clear_state(self, now_s: float) -> None:
        """The network controller shapes the cell no longer: the setting is the prior again."""
        with self._lock:
            self._state_at = None
            self._prior_bps = self._setting_bps
            self._forget(self._setting_bps, now_s)

    def set_uplink(
        self, robot: str, available_bps: float | None, now_s: float, *, stood: bool = False
    ) -> None:
        """Takes the network controller's word for what fusion can have of a robot's link upwards,
        and whether its queue there has stood; None: that link is not shaped any longer. A word
        that is not repeated goes stale."""
        with self._lock:
            if available_bps is None:
                if self._uplinks.pop(robot, None) is not None:
                    self._keep(robot, _new_link(now_s))
                return
            available_bps = max(FLOOR_BPS, available_bps)
            before = self._uplinks.get(robot)
            reference_bps = available_bps if before is None else before.reference_bps
            if before is None or _another(available_bps, reference_bps):
                self._keep(robot, _new_link(now_s))
                reference_bps = available_bps
            elif stood:
                self._keep(robot, _Filter(now_s))
            if before is not None or len(self._uplinks) < MAX_QUEUES:
                self._uplinks[robot] = _Uplink(available_bps, reference_bps, now_s)

    def capacity(self, now_s: float) -> tuple[float, str]:
        """C(t) in bit/s and where it comes from: `measured`, `net/state` or `prior`."""
        with self._lock:
            return self._capacity(now_s)

    def robot_limits(self, now_s: float) -> dict[str, float]:
        """bit/s of the robots whose own links are known to be narrower than the cell."""
        with self._lock:
            cell_bps, _ = self._capacity(now_s)
            limits = {robot: self._limit(robot, now_s) for robot in {*self._uplinks, *self._robots}}
            return {robot: bps for robot, bps in limits.items() if bps < cell_bps}

    def error_ratio(self, now_s: float) -> float | None:
        """How far what the cell's queue showed, and not what `net/state` makes of it, is from what
        a fresh `net/state` says, as a share of that; None without either."""
        with self._lock:
            if self._shown is None or not self._fresh(now_s):
                return None
            rate_bps, at = self._shown
            if now_s - at > STATE_FRESH_S:
                return None
            return (rate_bps - self._prior_bps) / self._prior_bps

    def _fresh(self, now_s: float) -> bool:
        return self._state_at is not None and now_s - self._state_at <= STATE_FRESH_S

    def _capacity(self, now_s: float) -> tuple[float, str]:
        prior_bps = self._prior_bps
        configured = self._fresh(now_s)
        source = "net/state" if configured else "prior"
        if self._cell.measured is None:
            return prior_bps, source
        measured_bps, _ = self._cell.measured
        if measured_bps >= prior_bps:
            return (prior_bps, source) if configured else (measured_bps, "measured")
        risen_bps = self._cell.risen(now_s)
        return (risen_bps, "measured") if risen_bps < prior_bps else (prior_bps, source)

    def _limit(self, robot: str, now_s: float) -> float:
        """bit/s of a robot's own link, infinite where nothing is known of it."""
        said = self._uplinks.get(robot)
        fresh = said is not None and now_s - said.at_s <= STATE_FRESH_S
        said_bps = said.available_bps if said is not None and fresh else math.inf
        held = self._robots.get(robot)
        return min(said_bps, held.risen(now_s)) if held is not None else said_bps

    def _keep(self, robot: str, held: _Filter) -> _Filter:
        self._robots[robot] = held
        self._robots.move_to_end(robot)
        if len(self._robots) > MAX_QUEUES:
            self._robots.popitem(last=False)
        return held

    def _forget(self, reference_bps: float, now_s: float) -> None:
        """What was seen of a link that was configured otherwise says nothing about this one."""
        self._reference_bps = reference_bps
        self._cell = _new_link(now_s)
        self._shown = None


def _new_link(now_s: float) -> _Filter:
    return _Filter(now_s + OLD_LINK_S)


def _another(bps: float, reference_bps: float) -> bool:
    return not reference_bps / NEW_LINK <= bps <= reference_bps * NEW_LINK
