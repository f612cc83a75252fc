"""When a station tells of an object: the generation rules of ETSI TS 103 324 V2.1.1, 6.1.

An object is told when it is new, or when since it was told last it has moved by more than 4 m, has
changed its speed by more than 0.5 m/s or its direction by 4 degrees or more, or a second has
passed. Persons are told all together, twice a second. Messages are 0.1 to 1 s apart; one a second
goes even without objects.

With redundancy mitigation by value of information, what counts is not what this station told last
but what anybody did: telling of an object is worth what it changes for those who heard of it, who
let it drive on as it did. Where that is less than the limits above, nothing is told.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

MOVED_M = 4.0
FASTER_M_S = 0.5
TURNED_RAD = math.radians(4.0)
LONGEST_S = 1.0
PERSONS_S = 0.5
SHORTEST_S = 0.1
SLACK_S = 1e-3
"""Frames of 10 Hz are no exact tenths."""
STANDING_M_S = 0.5
"""Below this speed an object has no direction: that of a velocity estimate is noise."""
SAME_M = 1.0
"""Objects of two stations nearer than this, each moved to one moment, are taken for one."""


@dataclass(frozen=True, slots=True)
class Seen:
    """An object that a station knows at a moment."""

    id: int
    """The station's own number for it."""
    person: bool
    x: float
    y: float
    """Metres in one frame for all stations."""
    vx: float
    vy: float
    """m/s."""

    def moved(self, seconds: float) -> Seen:
        """Where it is after some time, at its speed."""
        x, y = self.x + seconds * self.vx, self.y + seconds * self.vy
        return Seen(self.id, self.person, x, y, self.vx, self.vy)

    @property
    def speed(self) -> float:
        """m/s."""
        return math.hypot(self.vx, self.vy)


@dataclass(frozen=True, slots=True)
class _Told:
    at_s: float
    what: Seen


class Generation:
    """One station's messages. For one thread."""

    def __init__(self, *, mitigates: bool = False) -> None:
        """`mitigates`: leaves out what others have told already."""
        self._mitigates = mitigates
        self._told: dict[int, _Told] = {}
        self._heard: list[_Told] = []
        self._last_s = -math.inf

    def hear(self, now_s: float, objects: Sequence[Seen]) -> None:
        """Takes note of what another station told."""
        self._heard += [_Told(now_s, one) for one in objects]

    def due(self, now_s: float, objects: Sequence[Seen]) -> tuple[int, ...] | None:
        """Which objects, by their place in the sequence, go into a message now; None: no message.

        now_s: seconds of one clock; where it is set back, all begins anew. What is returned counts
        as told.
        """
        if now_s < self._last_s:
            self._told, self._heard, self._last_s = {}, [], -math.inf
        self._forget(now_s, objects)
        if now_s - self._last_s < SHORTEST_S - SLACK_S:
            return None
        chosen = {
            place
            for place, one in enumerate(objects)
            if not one.person and self._changed(one, now_s)
        }
        persons = [place for place, one in enumerate(objects) if one.person]
        if any(self._person_due(objects[place], now_s) for place in persons):
            chosen |= set(persons)
        if not chosen and now_s - self._last_s < LONGEST_S - SLACK_S:
            return None
        self._last_s = now_s
        self._told |= {objects[place].id: _Told(now_s, objects[place]) for place in chosen}
        return tuple(sorted(chosen))

    def _person_due(self, one: Seen, now_s: float) -> bool:
        last = self._known(one, now_s)
        return last is None or now_s - last.at_s >= PERSONS_S - SLACK_S

    def _changed(self, one: Seen, now_s: float) -> bool:
        """Whether an object is unknown, or no longer as it was told."""
        last = self._known(one, now_s)
        if last is None or now_s - last.at_s >= LONGEST_S - SLACK_S:
            return True
        before = last.what.moved(now_s - last.at_s) if self._mitigates else last.what
        if min(one.speed, before.speed) >= STANDING_M_S:
            turned = math.atan2(one.vy, one.vx) - math.atan2(before.vy, before.vx)
            if abs(math.remainder(turned, 2 * math.pi)) >= TURNED_RAD:
                return True
        moved = math.hypot(one.x - before.x, one.y - before.y)
        return moved > MOVED_M or abs(one.speed - before.speed) > FASTER_M_S

    def _known(self, one: Seen, now_s: float) -> _Told | None:
        """What was told last of an object: by this station, or where it mitigates by anybody."""
        own = self._told.get(one.id)
        others = [
            told
            for told in self._heard
            if math.dist(_place(told.what.moved(now_s - told.at_s)), (one.x, one.y)) <= SAME_M
        ]
        known = [told for told in (own, *others) if told is not None]
        return max(known, key=lambda told: told.at_s, default=None)

    def _forget(self, now_s: float, objects: Sequence[Seen]) -> None:
        """Drops what was told of objects that are gone, and what is too old to count."""
        there = {one.id for one in objects}
        self._told = {id_: told for id_, told in self._told.items() if id_ in there}
        fresh = [told for told in self._heard if now_s - told.at_s <= LONGEST_S]
        self._heard = fresh if self._mitigates else []


def _place(one: Seen) -> tuple[float, float]:
    return (one.x, one.y)
