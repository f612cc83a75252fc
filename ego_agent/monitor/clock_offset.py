"""How far a robot's clock is ahead of the ego's, bounded from both sides.

A message takes time, so one from the robot shows a least value of the offset, and one to the robot
(which it echoes in its beacons) a greatest value, as in NTP (RFC 5905). A bound holds until a
tighter one comes; meanwhile it loosens only as fast as clocks drift. A standing queue gives loose
bounds, which change nothing: it makes messages older and never shifts the clock.

All times are steady clocks' nanoseconds, which nobody sets: a time of day that jumps shows in the
same message as the difference between its two times.
"""

from __future__ import annotations

from dataclasses import dataclass

MAX_DRIFT = 200e-6
"""Two crystals drift apart by less than 100 ppm each."""
SYMMETRIC_NS = 50_000_000
"""Bounds that are closer are taken to be off by the same delay both ways. Of wider ones the queue
is somewhere, and the greatest offset is the one with which nothing looks fresher than it is."""
TOLERANCE_NS = 1_000_000
"""Bounds that cross by more contradict each other: one of the clocks stood still."""


@dataclass(slots=True)
class ClockOffset:
    """Bounds of one robot process's clock minus the ego's."""

    _least: tuple[int, int] | None = None
    """Nanoseconds, and when on the ego's clock; so is `_most`."""
    _most: tuple[int, int] | None = None
    _told_ns: int = 0
    """The robot's clock in its newest message."""

    def heard(self, robot_ns: int, now_ns: int) -> None:
        """Takes a message that left at `robot_ns` and came at `now_ns`; in order of sending."""
        if robot_ns < self._told_ns:
            self._least = self._most = None  # A clock that is no steady one was set back.
        self._told_ns = robot_ns
        value = robot_ns - now_ns
        if (most := self._upper(now_ns)) is not None and value > most + TOLERANCE_NS:
            self._most = None
        least = self._lower(now_ns)
        if least is None or value >= least:
            self._least = (value, now_ns)

    def echoed(self, ego_ns: int, robot_ns: int, now_ns: int) -> None:
        """Takes what the robot says: a message of the ego left at `ego_ns` and came at `robot_ns`.
        `heard` has taken the message that brings it."""
        value = robot_ns - ego_ns
        if (least := self._lower(now_ns)) is not None and value < least - TOLERANCE_NS:
            self._least = (min(value, self._told_ns - now_ns), now_ns)
        most = self._upper(now_ns)
        if most is None or value <= most:
            self._most = (value, now_ns)

    def now(self, now_ns: int) -> int:
        """The best estimate, nanoseconds; 0 where nothing is known."""
        least, most = self._lower(now_ns), self._upper(now_ns)
        if most is None or least is None:
            return least or 0
        return most - max(0, min(most - least, SYMMETRIC_NS)) // 2

    def _lower(self, now_ns: int) -> int | None:
        return self._least and self._least[0] - _drift(now_ns - self._least[1])

    def _upper(self, now_ns: int) -> int | None:
        return self._most and self._most[0] + _drift(now_ns - self._most[1])


def _drift(span_ns: int) -> int:
    return round(MAX_DRIFT * max(0, span_ns))
