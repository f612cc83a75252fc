"""What robots publish once for several egos, and whether this ego relies on it.

A robot that publishes says so in its answers (`Observation.shared_s`). The ego then listens, and
goes on asking until something has come that way; from then on it asks that robot every two seconds,
so that the robot knows that it still wants it. Where nothing comes for a few frames it asks again
as if nobody else did, for a while.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from swarm import keyspace
from swarm.errors import TransportError
from swarm.messages import Algorithm, Observation
from swarm.session import Session

KEPT = 4
"""Newest frames kept of each robot: one may come before the ego has its own scan."""
RENEWED_IN = 0.5
"""Of the time for which frames are promised."""
UNUSED_S = 3.0
"""After that, what is not used is not listened to any more."""
MAX_MISSED = 3
"""Frames in a row that did not come: more are not waited for."""
DISTRUST_S = 10.0
NEAR = 0.55
"""Of a frame period: a frame so near in time to the one that is wanted is that frame."""


@dataclass(slots=True)
class _Source:
    """One robot's frames in one algorithm."""

    withdraw: Callable[[], None]
    used_at: float
    until: float = 0.0
    """The promise ends."""
    renew_at: float = 0.0
    missed: int = 0
    relied: bool = False
    """Something has come."""
    frames: deque[tuple[Observation, float]] = field(default_factory=lambda: deque(maxlen=KEPT))
    """With when each was there."""


class SharedFrames:
    """Used by the asking thread only. Times are `time.monotonic()` seconds."""

    def __init__(self, on_frame: Callable[[Observation], None], period_s: float) -> None:
        """`on_frame` hears of what comes, on Zenoh's threads; who it hands it to calls `take`.
        `period_s`: of frames."""
        self._on_frame = on_frame
        self._near_ns = round(NEAR * period_s * 1e9)
        self._sources: dict[tuple[str, Algorithm], _Source] = {}
        self._distrusted: dict[tuple[str, Algorithm], float] = {}

    def wants(self, robot: str, algorithm: Algorithm, now: float) -> bool:
        """Whether the robot may be told that the ego would share."""
        return now >= self._distrusted.get((robot, algorithm), 0.0)

    def promised(
        self, session: Session, robot: str, algorithm: Algorithm, seconds: float, now: float
    ) -> None:
        """The robot publishes for so long; 0: it does not."""
        name = (robot, algorithm)
        source = self._sources.get(name)
        if seconds <= 0.0 or not self.wants(robot, algorithm, now):
            if source is not None:
                source.until = 0.0
            return
        if source is None:
            key = keyspace.shared(session.swarm, robot, algorithm)
            try:
                withdraw = session.subscribe(key, Observation, self._on_frame)
            except TransportError:
                return  # Closing: nothing is asked for any more.
            source = self._sources[name] = _Source(withdraw, now)
        source.until, source.renew_at = now + seconds, now + RENEWED_IN * seconds

    def relies(self, robot: str, algorithm: Algorithm, now: float) -> bool:
        """Whether the next frame of the robot is waited for, and not asked for."""
        source = self._sources.get((robot, algorithm))
        if source is None or not source.relied or now >= source.until:
            return False
        source.used_at = now
        return True

    def is_due(self, robot: str, algorithm: Algorithm, now: float) -> bool:
        """Whether the robot should be told again that its frames are wanted; true once a renewal,
        which may stay without an answer."""
        source = self._sources[robot, algorithm]
        if now < source.renew_at:
            return False
        source.renew_at = now + RENEWED_IN * max(0.1, source.until - now)
        return True

    def take(self, seen: Observation, at: float) -> bool:
        """Takes in what was published; False for what nobody listens to any more."""
        source = self._sources.get((seen.robot, seen.algorithm))
        if source is None:
            return False
        source.relied = True
        source.frames.append((seen, at))
        return True

    def find(
        self, robot: str, algorithm: Algorithm, capture_ns: int, *, at_most_ns: int | None = None
    ) -> tuple[Observation, float] | None:
        """The frame captured then on the robot's clock, and when it came; None where it has not
        come. With `at_most_ns` the nearest, so far off at most."""
        source = self._sources.get((robot, algorithm))
        if source is None or not source.frames:
            return None
        found = min(source.frames, key=lambda one: abs(one[0].capture_ns - capture_ns))
        off_ns = abs(found[0].capture_ns - capture_ns)
        if off_ns > (self._near_ns if at_most_ns is None else at_most_ns):
            return None
        source.missed = 0
        return found

    def missed(self, robot: str, algorithm: Algorithm, now: float) -> None:
        """A frame that was relied upon did not come."""
        source = self._sources.get((robot, algorithm))
        if source is None:
            return
        source.missed += 1
        if source.missed >= MAX_MISSED:
            self._distrusted[robot, algorithm] = now + DISTRUST_S
            self._end(robot, algorithm)

    def tidy(self, now: float) -> None:
        """Ends listening to what has not been used for a while."""
        for (robot, algorithm), source in list(self._sources.items()):
            if now - source.used_at > UNUSED_S and now - source.renew_at > UNUSED_S:
                self._end(robot, algorithm)
        self._distrusted = {n: until for n, until in self._distrusted.items() if until > now}

    def _end(self, robot: str, algorithm: Algorithm) -> None:
        self._sources.pop((robot, algorithm)).withdraw()
