"""How often a frame is fused, and how long it waits for the robots."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ego_agent.knowledge.objective import Objective
from swarm.messages import Algorithm, Assignment, Decision

MAX_DEADLINE_S = 0.85
"""A slower pace may wait this long, so that what is fused is not older than a second."""
FADES_S = 0.7
"""In this time a result that is moved with its objects loses two thirds of its worth, as a late
contribution does (perception/fusion/compensation.py)."""


SLOWER_HZ = (5.0, 2.5, 2.0, 1.0)
"""Rates that a live ego may choose instead of the set one."""


RARER_HZ = (5.0, 2.0, 1.0, 0.5)
"""Rates at which a live ego may ask single robots."""


PLACES_HZ = 10.0
"""How often, at most, a live ego asks in between about the places of what it remembers."""


EVERYTHING = 4
"""Of so many contributions of objects only one is of everything: what stands too near to something
else to be told from it is seen then, and remembered."""


@dataclass(frozen=True, slots=True)
class Pace:
    """A fusion rate and its deadline."""

    rate_hz: float
    deadline_s: float

    def freshness(self, fastest: Pace, frame_s: float) -> float:
        """What results are worth that come at this pace, against the fastest, in (0, 1].

        exp(-(a - a0) / FADES_S), where a = 1 / (2 f) is the mean age of the newest result beside
        the time that it took, f = min(rate, 1 / frame_s) the frames that the ego keeps up with, and
        a0 the same of the fastest pace, had the ego all the time that it needs.
        """
        interval_s = max(1.0 / self.rate_hz, frame_s)
        return math.exp(-(interval_s - 1.0 / fastest.rate_hz) / (2.0 * FADES_S))


USUAL = Pace(Objective().rate_hz, Objective().deadline_s)


def paces(objective: Objective) -> tuple[Pace, ...]:
    """Those that may be chosen, fastest first.

    A slower one waits for the robots up to a whole period, at most MAX_DEADLINE_S.
    """
    fastest = Pace(objective.rate_hz, objective.deadline_s)
    slower = sorted(
        {rate for rate in objective.slower_hz if rate < objective.rate_hz}, reverse=True
    )
    waits = [max(objective.deadline_s, min(MAX_DEADLINE_S, 1.0 / rate)) for rate in slower]
    return (fastest, *(Pace(rate, wait_s) for rate, wait_s in zip(slower, waits, strict=True)))


def due(decision: Decision, robot: str, number: int) -> bool:
    """Whether a participant contributes to the fused frame of that number."""
    rates = {one.robot: one.rate_hz for one in decision.assignments}
    return robot not in rates or robot in in_turn(rates, decision.rate_hz, number)


def in_turn(rates: Mapping[str, float], frames_hz: float, number: int) -> tuple[str, ...]:
    """Who contributes to the fused frame of that number, of robots with these rates.

    Robots of one rate take turns, by their names: a frame takes up few, and a place that several
    see is seen anew more often.
    """
    places: Counter[int] = Counter()
    found = []
    for robot in sorted(rates):
        step = every_nth(rates[robot], frames_hz)
        if number % step == places[step] % step:
            found.append(robot)
        places[step] += 1
    return tuple(found)


def about_places(
    assignments: Sequence[Assignment], frames_hz: float, number: int
) -> tuple[str, ...]:
    """Who is asked about places for the fused frame of that number: in turn, by their names, those
    of whom that is wanted and who do not contribute to it anyway."""
    whole = in_turn({one.robot: one.rate_hz for one in assignments}, frames_hz, number)
    often = {one.robot: one.places_hz for one in assignments if one.places_hz > 0.0}
    return tuple(robot for robot in in_turn(often, frames_hz, number) if robot not in whole)


def of_objects(rate_hz: float, frames_hz: float, number: int) -> bool:
    """Whether who contributes at a rate, and sends objects only, does so to the fused frame of that
    number, if it contributes to that at all: of EVERYTHING contributions one has all points."""
    step = every_nth(rate_hz, frames_hz)
    # Robots that take turns send all in different ones.
    return (number // step + number % step) % EVERYTHING != 0


def sends_objects(decision: Decision, number: int) -> frozenset[str]:
    """The participants of whom that is so."""
    return frozenset(
        one.robot
        for one in decision.assignments
        if one.objects_only and of_objects(one.rate_hz, decision.rate_hz, number)
    )


def rate_of(decision: Decision, robot: str) -> float:
    """Contributions a second of a participant."""
    rates = (one.rate_hz for one in decision.assignments if one.robot == robot)
    return next(rates, decision.rate_hz)


def algorithm_of(decision: Decision, robot: str) -> Algorithm:
    """What a participant sends."""
    forms = (one.algorithm for one in decision.assignments if one.robot == robot)
    return next(forms, decision.algorithm)


def stride(decision: Decision, sensor_hz: float, most_hz: float) -> int:
    """Frames of a sensor from one fused frame to the next, at most `most_hz` fused frames."""
    return every_nth(min(decision.rate_hz, most_hz), sensor_hz)


def in_step(rate_hz: float, frames_hz: float) -> float:
    """What a rate comes to where it is every n-th of so many frames a second.

    >>> in_step(10.0, 5.0), in_step(2.0, 5.0), in_step(2.0, 10.0)
    (5.0, 2.5, 2.0)
    """
    return frames_hz / every_nth(rate_hz, frames_hz)


def every_nth(rate_hz: float, frames_hz: float) -> int:
    """Which frame is every n-th at that rate, of so many a second."""
    return max(1, round(frames_hz / rate_hz))


def often(rate_hz: float) -> str:
    """A rate in words.

    >>> often(5.0), often(0.5)
    ('5 times a second', 'every 2 s')
    """
    if rate_hz < 1.0:
        return f"every {1.0 / rate_hz:g} s"
    return "once a second" if rate_hz == 1.0 else f"{rate_hz:g} times a second"
