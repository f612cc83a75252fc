"""The frames between asking and fusing: which are under way, and when to ask for the next one.

While one frame is fused, robots already encode the next. A frame that could only wait for its turn
is not asked for yet: it would be older when it is fused, and robots would have worked for nothing
if a newer one took its place.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass

from ego_agent.execute.frame_round import FrameRound
from ego_agent.execute.sense import OwnFrame
from perception.fusion.base import Fusion, Gathering
from swarm.loop_watch import Turned, nobody
from swarm.messages import Algorithm, Decision

MAX_FRAMES = 4
"""Under way at a time: what a deadline of a quarter of a second takes at 10 Hz, and one that is
fused."""
LEARNT = 0.2
"""Weight of the newest frame in the expected times (exponential moving average)."""
TURN_S = 1.0
"""Who waits for a frame tells at least this often that it does."""


@dataclass(frozen=True, slots=True, eq=False)
class AskedFrame:
    """One frame that robots were asked for."""

    decision: Decision
    own: OwnFrame
    algorithm: Algorithm
    """Of what its robots are asked for; `mixed` where that differs."""
    fusion: Fusion
    gathering: Gathering
    round: FrameRound


class Pipeline:
    """Frames in the order in which they were asked for and are fused. Thread-safe; times are
    `time.monotonic()` seconds."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: deque[AskedFrame] = deque()
        self._fusing: AskedFrame | None = None
        self._taken_at = 0.0
        self._closed = False
        self._answer_s = 0.0
        """Expected time from asking to the last answer, or to the deadline."""
        self._fuse_s = 0.0
        """Expected time from the last answer, or the frame's turn, to its fused boxes."""

    def put(self, frame: AskedFrame) -> None:
        """Adds the newest frame."""
        with self._changed:
            self._waiting.append(frame)
            self._changed.notify_all()

    def take(self, turned: Turned = nobody) -> AskedFrame | None:
        """Waits for the next frame to fuse, and calls `turned` meanwhile; None after `close`, when
        all were taken. Call `done` before the next one."""
        turned()
        with self._changed:
            while not self._waiting and not self._closed:
                self._changed.wait(TURN_S)
                turned()
            if not self._waiting:
                return None
            self._fusing = self._waiting.popleft()
            self._taken_at = time.monotonic()
            return self._fusing

    def done(self) -> None:
        """The frame that was taken last is fused, or has failed."""
        with self._changed:
            frame, self._fusing = self._fusing, None
            if frame is None or frame.round.closed_at is None:
                return
            closed_at = frame.round.closed_at
            fuse_s = time.monotonic() - max(closed_at, self._taken_at)
            self._fuse_s += LEARNT * (fuse_s - self._fuse_s)
            self._answer_s += LEARNT * (closed_at - frame.round.begun_at - self._answer_s)

    def close(self) -> None:
        """No frame will come any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def has_time(self, now: float) -> bool:
        """Whether one more frame could be fused before the next one's answers are expected."""
        with self._changed:
            if not self._waiting:
                return True
            done = self._waiting[0].round
            answered_at = done.closed_at or done.begun_at + self._answer_s
            return answered_at - now >= self._fuse_s

    def full_for_s(self, now: float) -> float:
        """How long to wait before the next frame is asked for; infinite until `done`, not positive
        when its answers will hardly have to wait for their turn."""
        with self._changed:
            frames = ([self._fusing] if self._fusing else []) + list(self._waiting)
            if not frames:
                return 0.0
            if len(frames) >= MAX_FRAMES:
                return math.inf
            free_at = self._taken_at if self._fusing else now
            for frame in frames:
                answered_at = frame.round.closed_at or frame.round.begun_at + self._answer_s
                free_at = max(free_at, answered_at) + self._fuse_s
            return free_at - self._answer_s - now
