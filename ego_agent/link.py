"""C(t): how many bits a second the ego's link delivers, and each robot's own link, from the rounds.

Maximum filters over the delivery rates of the last `WINDOW_S`, in the manner of BBR (Cardwell et
al., "BBR: Congestion-Based Congestion Control", ACM Queue 14-5, 2016). As in BBR, a round that did
not fill a link cannot lower its estimate; `rounds.py` says which did. Rounds of comparable size
vouch for each other, so that one hiccup of a busy machine lowers nothing, and a quick round raises
an estimate to what it shows the link to carry at least.

- A round without any answer in time says that the link is much slower than thought, or gone: each
  takes the estimate down by `TIMEOUT_DECAY`.
- Without rounds that fill the link, an estimate rises, doubling every `DOUBLING_S` (BBR probes for
  bandwidth in the same spirit): the cell's towards the prior, a robot's until it is no narrower
  than the cell. A link that has recovered is found out without traffic for its own sake.

The prior of the cell is what the network controller last said that fusion can have (`net/state`),
else the setting; a robot's link counts as wide as the cell until something shows the contrary. No
estimate exceeds a fresh `net/state`.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict, deque
from typing import NamedTuple

from ego_agent.rounds import FLOOR_BPS, OUTPACED, Round, Sample

WINDOW_S = 1.0
MAX_SAMPLES = 10
"""Samples of one link in the window; BBR keeps ten round trips."""
COMPARABLE = 0.5
"""Samples with at least this share of a sample's bytes are held against it."""
TIMEOUT_DECAY = 0.85
DOUBLING_S = 5.0
STATE_FRESH_S = 5.0
"""`net/state` comes at 1 Hz; after this silence it is only a prior. A measured rate counts as the
present one for as long."""
NEW_LINK = 1.25
"""A link whose configured rate has moved by this factor, up or down, is another link: what was
measured on the old one is forgotten. Less is telemetry that comes and goes."""
MAX_ROBOTS = 512
"""Robots whose links are remembered; the longest unheard is dropped."""


class _Filter:
    """The measured rate of one link; None until the link was the limit."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, Sample]] = deque(maxlen=MAX_SAMPLES)
        self.measured: tuple[float, float] | None = None
        """bit/s and when."""

    def add(self, sample: Sample, now_s: float) -> None:
        """Takes what one round shows."""
        self._samples.append((now_s, sample))
        if not sample.filled:
            if self.measured is not None and sample.rate_bps > self.risen(now_s):
                self.measured = (sample.rate_bps, now_s)
            return
        least = sample.size * COMPARABLE
        recent = [s for at, s in self._samples if now_s - at <= WINDOW_S and s.size >= least]
        filled = [s.rate_bps for s in recent if s.filled]
        if 2 * len(filled) > len(recent):
            self.measured = (max(filled), now_s)

    def risen(self, now_s: float) -> float:
        """bit/s that are worth a try by now; infinite where nothing was measured."""
        if self.measured is None:
            return math.inf
        rate_bps, at = self.measured
        return rate_bps * math.exp2(min(64.0, max(0.0, now_s - at) / DOUBLING_S))


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
        self._robots: OrderedDict[str, _Filter] = OrderedDict()
        self._uplinks: dict[str, _Uplink] = {}

    def add_round(self, done: Round, now_s: float) -> None:
        """Takes what one round shows of the links."""
        with self._lock:
            sole = done.sole
            if sole is not None and done.cell.filled and self._own_doing(sole, done.cell, now_s):
                self._filter(sole).add(done.cell, now_s)
                return
            self._cell.add(done.cell, now_s)
            for robot, sample in done.robots.items():
                self._filter(robot).add(sample, now_s)

    def silence(self, now_s: float) -> None:
        """Takes a round into the estimate in whose time nothing at all has arrived."""
        with self._lock:
            current_bps, _ = self._capacity(now_s)
            self._cell.measured = (max(FLOOR_BPS, current_bps * TIMEOUT_DECAY), now_s)

    def set_state(self, available_bps: float, now_s: float) -> None:
        """Takes the network controller's word for what fusion can have of the cell."""
        with self._lock:
            available_bps = max(FLOOR_BPS, available_bps)
            if self._state_at is None or _another(available_bps, self._reference_bps):
                self._forget(available_bps)
            self._prior_bps = available_bps
            self._state_at = now_s

    def clear_state(self) -> None:
        """The network controller shapes the cell no longer: the setting is the prior again."""
        with self._lock:
            self._state_at = None
            self._prior_bps = self._setting_bps
            self._forget(self._setting_bps)

    def set_uplink(self, robot: str, available_bps: float | None, now_s: float) -> None:
        """Takes the network controller's word for what fusion can have of a robot's link upwards;
        None: that link is not shaped any longer. A word that is not repeated goes stale."""
        with self._lock:
            if available_bps is None:
                if self._uplinks.pop(robot, None) is not None:
                    self._robots.pop(robot, None)
                return
            available_bps = max(FLOOR_BPS, available_bps)
            before = self._uplinks.get(robot)
            reference_bps = available_bps if before is None else before.reference_bps
            if before is None or _another(available_bps, reference_bps):
                self._robots.pop(robot, None)
                reference_bps = available_bps
            if before is not None or len(self._uplinks) < MAX_ROBOTS:
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
        """How far what was measured, and not what `net/state` makes of it, is from what a fresh
        `net/state` says, as a share of that; None without either."""
        with self._lock:
            if self._cell.measured is None or not self._fresh(now_s):
                return None
            rate_bps, at = self._cell.measured
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

    def _own_doing(self, robot: str, cell: Sample, now_s: float) -> bool:
        """Whether a robot that sent alone was slow of its own, as far as anybody can tell: the
        controller says that the cell is wider, or its link was found narrow beside others."""
        if self._fresh(now_s):
            return cell.rate_bps * OUTPACED < self._prior_bps
        return self._limit(robot, now_s) <= cell.rate_bps * OUTPACED

    def _filter(self, robot: str) -> _Filter:
        held = self._robots.setdefault(robot, _Filter())
        self._robots.move_to_end(robot)
        if len(self._robots) > MAX_ROBOTS:
            self._robots.popitem(last=False)
        return held

    def _forget(self, reference_bps: float) -> None:
        """Rounds over a link that was configured otherwise say nothing about this one."""
        self._reference_bps = reference_bps
        self._cell = _Filter()
        self._robots.clear()


def _another(bps: float, reference_bps: float) -> bool:
    return not reference_bps / NEW_LINK <= bps <= reference_bps * NEW_LINK
