"""What several egos want of one robot: published once for all of them, where that costs it less
than answering each.

An ego that asks says whether it would share (`ObservationRequest.shares`); asking is also how it
renews its interest. Once several egos have asked for the same algorithm, answers promise for a
while that frames are published (`Observation.shared_s`), and egos that receive them ask every
two seconds in place of once a frame. Nobody depends on another one's asking: an ego that ends is
forgotten, and the last one left is answered again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from perception.fusion.base import EncodeOptions
from swarm.geometry import Pose
from swarm.messages import ObservationRequest

PROMISE_S = 4.0
"""How long an answer promises frames; egos renew it in half of that."""
INTEREST_S = 1.5 * PROMISE_S
"""An ego that has not asked for so long wants nothing any more."""
MAX_EGOS = 64
"""Of one algorithm; more are answered one by one."""
MAX_SHARED_BYTES = 60_000
"""Of a payload: it is pushed as one message, which has to fit a Zenoh batch. A larger one travels
in parts, as fast as each asker takes them."""
TOO_DEAR_S = 10.0
"""For so long nothing is published that turned out to cost more than it saves."""
_LEARNT = 0.2


@dataclass(frozen=True, slots=True)
class _Interest:
    """What one ego asked for last."""

    at: float
    step: int
    """Every so many frames."""
    options: EncodeOptions
    reference: Pose | None
    most_bytes: int


@dataclass(slots=True)
class _Algorithm:
    interests: dict[str, _Interest] = field(default_factory=dict)
    """By ego."""
    promised_until: float = 0.0
    not_before: float = 0.0
    single_bytes: float = 0.0
    """Of an answer to one ego, smoothed; 0 before the first."""
    shared_bytes: float = 0.0


class Sharing:
    """One robot's. Safe for several threads. Times are `time.monotonic()` seconds."""

    def __init__(self, shareable: Callable[[str], bool], rate_hz: float) -> None:
        """`shareable`: whether several egos can use one payload of an algorithm. `rate_hz`: of the
        robot's frames."""
        self._shareable = shareable
        self._rate_hz = rate_hz
        self._lock = threading.Lock()
        self._of: dict[str, _Algorithm] = {}

    def asked(self, request: ObservationRequest, now: float) -> float:
        """Notes what an ego wants; returns for how long frames are published for it, 0 where it is
        to be answered."""
        name = request.algorithm
        if not request.shares or not self._shareable(name):
            return 0.0
        with self._lock:
            known = self._of.setdefault(name, _Algorithm())
            _forget(known, now)
            if request.ego not in known.interests and len(known.interests) >= MAX_EGOS:
                return 0.0
            known.interests[request.ego] = _Interest(
                now,
                max(1, round(self._rate_hz / (request.rate_hz or self._rate_hz))),
                EncodeOptions(request.max_error_m, request.keep_ground),
                request.reference_pose(),
                request.max_bytes,
            )
            if not _pays(known, now):
                return 0.0
            # All who share take one form: the first one's.
            if known.interests[request.ego].options != _options(known):
                return 0.0
            known.promised_until = now + PROMISE_S
            return PROMISE_S

    def due(self, frame: int, now: float) -> list[tuple[str, EncodeOptions]]:
        """What is to be published of a frame: algorithms, and their form but for the robot's
        pose."""
        found = []
        with self._lock:
            for name, known in self._of.items():
                _forget(known, now)
                steps = {interest.step for interest in known.interests.values()}
                if now < known.promised_until and any(frame % step == 0 for step in steps):
                    found.append((name, _form(known)))
        return found

    def published_now(self, now: float) -> tuple[str, ...]:
        """The algorithms in which frames are published."""
        with self._lock:
            return tuple(name for name, known in self._of.items() if now < known.promised_until)

    def answered(self, algorithm: str, size: int) -> None:
        """An ego was answered by itself, with so many bytes."""
        with self._lock:
            known = self._of.get(algorithm)
            if known is not None:
                before = known.single_bytes or size
                known.single_bytes = before + _LEARNT * (size - before)

    def published(self, algorithm: str, size: int, now: float) -> bool:
        """So many bytes are to be published; False where they may not: somebody's link does not
        carry them, or answering each costs less. What was promised is answered then."""
        with self._lock:
            known = self._of[algorithm]
            _forget(known, now)
            known.shared_bytes = size
            most = min((one.most_bytes for one in known.interests.values()), default=0)
            if size > min(most, MAX_SHARED_BYTES):
                known.promised_until, known.not_before = 0.0, now + TOO_DEAR_S
                return False
            return True


def _forget(known: _Algorithm, now: float) -> None:
    known.interests = {e: i for e, i in known.interests.items() if now - i.at < INTEREST_S}


def _form(known: _Algorithm) -> EncodeOptions:
    """How it is encoded, but for the robot's pose: for everybody where somebody does not say where
    it is."""
    options = _options(known)
    places = [one.reference for _, one in sorted(known.interests.items())]
    egos = tuple(place for place in places if place is not None)
    if len(egos) < len(places):
        return options
    return EncodeOptions(options.max_error_m, options.keep_ground, egos=egos)


def _options(known: _Algorithm) -> EncodeOptions:
    first = min(known.interests)
    return known.interests[first].options


def _pays(known: _Algorithm, now: float) -> bool:
    """Whether publishing once takes less of the robot's link than answering each."""
    askers = len(known.interests)
    if askers < 2 or now < known.not_before:
        return False
    if known.single_bytes and known.shared_bytes > askers * known.single_bytes:
        known.not_before = now + TOO_DEAR_S
        known.shared_bytes = 0.0  # Tried again then: egos may have moved.
        return False
    return True
