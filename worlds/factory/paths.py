"""How actors move: along closed loops that repeat seamlessly, or not at all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from swarm.geometry import TWO_PI

_QUARTERS = ((1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (0.0, 1.0))
"""Cosine and sine of 0, -90, -180, -270 degrees, exactly."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Where an actor is and how it moves: metres, radians, m/s, in the world frame."""

    x: float
    y: float
    heading: float
    speed: float

    @property
    def velocity(self) -> tuple[float, float, float]:
        """World frame, m/s."""
        return (self.speed * math.cos(self.heading), self.speed * math.sin(self.heading), 0.0)


class Path(Protocol):
    """A course in time."""

    def at(self, time_s: float) -> Motion:
        """The motion at a time since the start of the world."""
        ...


@dataclass(frozen=True, slots=True)
class Standing:
    """A place that is never left."""

    x: float
    y: float
    heading: float

    def at(self, time_s: float) -> Motion:
        """Always the same."""
        return Motion(self.x, self.y, self.heading, 0.0)


@dataclass(frozen=True, slots=True)
class Loop:
    """A square with rounded corners, driven clockwise: neighbours keep right in a shared aisle."""

    x: float
    y: float
    half: float
    """Half the side of the square block that the loop goes around."""
    offset: float
    """Distance of the loop from the block, and radius of its corners."""

    @property
    def length(self) -> float:
        """Metres."""
        return 8 * self.half + TWO_PI * self.offset

    def point(self, way: float) -> tuple[float, float, float]:
        """x, y and heading after `way` metres from the south end of the west side."""
        quarter = self.length / 4
        turns, rest = divmod(way % self.length, quarter)
        straight = 2 * self.half
        if rest <= straight:
            x, y, heading = -self.half - self.offset, rest - self.half, math.pi / 2
        else:
            turn = (rest - straight) / self.offset
            x = -self.half - self.offset * math.cos(turn)
            y = self.half + self.offset * math.sin(turn)
            heading = math.pi / 2 - turn
        index = int(turns) % 4
        cos, sin = _QUARTERS[index]
        return (
            self.x + cos * x - sin * y,
            self.y + sin * x + cos * y,
            heading - index * math.pi / 2,
        )


@dataclass(frozen=True, slots=True)
class Laps:
    """A whole number of laps of a loop in one period, so that the end joins the start."""

    loop: Loop
    laps: int
    period_s: float
    phase: float = 0.0
    """Laps already driven at time 0, when `sway` is 0."""
    sway: float = 0.0
    """From 0 to below 1: the speed changes by this share within a lap..."""
    slow_at: float = 0.0
    """...and is lowest this share of a lap's time after time 0."""

    def at(self, time_s: float) -> Motion:
        """The motion at a time; the heading follows the loop."""
        lap = self.laps * time_s / self.period_s
        swing = TWO_PI * (lap - self.slow_at)
        done = self.phase + lap - self.sway * math.sin(swing) / TWO_PI
        pace = self.laps / self.period_s * (1.0 - self.sway * math.cos(swing))
        x, y, heading = self.loop.point((done % 1.0) * self.loop.length)
        return Motion(x, y, heading, pace * self.loop.length)
