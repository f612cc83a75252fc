"""Whether what comes under one robot's name comes from one process."""

from __future__ import annotations

from dataclasses import dataclass, field

from swarm.messages import Beacon

DUPLICATE_WINDOW_S = 2.0
"""Two processes that are heard in turn within this time share an id."""
SEQ_SLACK, SEQ_PER_S = 1000, 100
"""A robot numbers its beacons and scenes one by one. Numbers of one instance that are farther apart
than so many, and so many a second since it was heard, come from two processes."""


@dataclass(slots=True)
class Numbers:
    """Of one kind of message of one process. Times are seconds of a steady clock."""

    last: int = -1
    at: float = 0.0
    """When that came."""
    ahead: int = -1
    """The last that was too far ahead."""

    def follows(self, seq: int, now: float) -> bool | None:
        """Whether a number comes next; None where it cannot be of the same process.

        Where numbers far below come, or nothing but numbers far ahead for a while, those count from
        then on: what was counted before was not the process's own, or the ego has slept.
        """
        most = SEQ_SLACK + SEQ_PER_S * (now - self.at)
        if self.last < 0 or self.last < seq <= self.last + most:
            self._go_on(seq, now)
            return True
        if self.last - SEQ_SLACK <= seq <= self.last:
            return False
        if seq < self.last:
            self._go_on(seq, now)
        elif self.ahead < seq <= self.ahead + SEQ_SLACK and now - self.at > DUPLICATE_WINDOW_S:
            self._go_on(seq, now)
            return True
        else:
            self.ahead = seq
        return None

    def _go_on(self, seq: int, now: float) -> None:
        self.last, self.at, self.ahead = seq, now, -1


@dataclass(slots=True)
class Stream:
    """What came from one process (instance) of a robot."""

    heard_at: float
    beacons: Numbers = field(default_factory=Numbers)
    scenes: Numbers = field(default_factory=Numbers)


def twins(known: Beacon, beacon: Beacon) -> bool:
    """Whether two beacons of one number are not the same: two processes then use one instance."""
    if (known.instance, known.seq) != (beacon.instance, beacon.seq):
        return False
    return (known.sent_ns, known.capture_ns, known.pose) != (
        beacon.sent_ns,
        beacon.capture_ns,
        beacon.pose,
    )
