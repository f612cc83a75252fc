"""Who sends what, and how often, on a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ego_agent.knowledge.pace import about_places, in_turn, of_objects
from research.evaluation.ways.planned import Decided
from research.evaluation.windows.links import Link
from swarm.messages import Assignment


@dataclass(frozen=True, slots=True)
class Way:
    """One way to share a drive's frames."""

    name: str
    forms: tuple[tuple[str, float], ...] = ()
    """Algorithm and contributions a second of the nearest robot, the next, and so on; the last one
    also of all that are farther. None: nobody sends."""
    memory: bool = True
    max_error_m: float = 0.1
    """Of points that are sent."""
    in_turn: bool = False
    """Whether robots of one rate send in different frames, not all in the same."""
    late_frames: int = 0
    """Of so many frames before contributions come; memory takes them up then."""
    silent: tuple[int, int] | None = None
    """(period, frames): of each period of frames nobody sends in the last ones."""
    link: Link | None = None
    """What carries the contributions; None: all are there at once."""
    link_from_s: float = 0.0
    """Of the link's time, when the drive begins."""
    decided: Decided | None = None
    """Who decides, in place of `forms`."""
    assignments: tuple[Assignment, ...] = ()
    """Who sends what and how often, in turn, in place of `forms`."""
    places_hz: float = 0.0
    """How often robots with one of the `forms` are asked about the places of what is remembered,
    where they do not send anyway; 0: never."""
    objects_only: bool = False
    """Whether these send only what may be an object, but for places."""

    @property
    def asks_about_places(self) -> bool:
        """Whether robots may be asked about places in between."""
        if self.decided is not None:
            return self.decided.asks_about_places
        return self.places_hz > 0.0 or any(one.places_hz > 0.0 for one in self.assignments)

    def asked(self, number: int, nearest: Sequence[str], rate_hz: float) -> Mapping[str, str]:
        """The robots that send in the frame of that number, nearest first, and what. `rate_hz`: of
        the drive's frames."""
        if self.assignments:
            due = in_turn({one.robot: one.rate_hz for one in self.assignments}, rate_hz, number)
            return {one.robot: one.algorithm for one in self.assignments if one.robot in due}
        if not self.forms or self._silent(number):
            return {}
        asked = {}
        for place, robot in enumerate(nearest):
            algorithm, hz = self.forms[min(place, len(self.forms) - 1)]
            step = max(1, round(rate_hz / hz))
            if number % step == (place % step if self.in_turn else 0):
                asked[robot] = algorithm
        return asked

    def asked_about(self, number: int, nearest: Sequence[str], rate_hz: float) -> Mapping[str, str]:
        """The robots that are asked about places in the frame of that number, and what."""
        if self.assignments:
            forms = {one.robot: one.algorithm for one in self.assignments}
            robots = about_places(self.assignments, rate_hz, number)
            return {robot: forms[robot] for robot in robots}
        if not self.places_hz or not self.forms or self._silent(number):
            return {}
        whole = self.asked(number, nearest, rate_hz)
        robots = in_turn(dict.fromkeys(nearest, self.places_hz), rate_hz, number)
        forms = {r: self.forms[min(i, len(self.forms) - 1)][0] for i, r in enumerate(nearest)}
        return {robot: forms[robot] for robot in robots if robot not in whole}

    def objects(self, number: int, nearest: Sequence[str], rate_hz: float) -> frozenset[str]:
        """The robots that send only what may be an object to the frame of that number."""
        rates = {one.robot: one.rate_hz for one in self.assignments if one.objects_only}
        if self.objects_only:
            last = len(self.forms) - 1
            rates = {robot: self.forms[min(i, last)][1] for i, robot in enumerate(nearest)}
        return frozenset(robot for robot, hz in rates.items() if of_objects(hz, rate_hz, number))

    def _silent(self, number: int) -> bool:
        if self.silent is None:
            return False
        return number % self.silent[0] >= self.silent[0] - self.silent[1]
