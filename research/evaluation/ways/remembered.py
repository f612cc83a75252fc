"""What the ego of a drive remembers, and what it asks about because of that."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping

from perception.memory.asking import places_of
from perception.memory.memory import Frame, Memory, Remembered
from perception.memory.remembering import remember, suspected
from perception.memory.reprocessing import ReprocessingMemory
from research.evaluation.ways.drive import OBJECTS, Driven, Focus, FusedOnce

LAG_FRAMES = 2
"""A frame is asked for when that before it may not be fused yet: what is known is of so many before
(docs/benchmarks.md: from asking to boxes takes 50 to 110 ms)."""
Asked = Mapping[str, str]
"""What robots are asked for."""


def taken(
    memory: Memory | ReprocessingMemory, driven: Driven, frame: int, fused: FusedOnce
) -> Remembered | None:
    """What memory makes of a frame."""
    given = Frame(
        frame / driven.world.rate_hz,
        fused.found,
        fused.helpers,
        fused.views,
        fused.world_from_own,
        focused=fused.focused,
        places=fused.places,
        objects_only=fused.objects_only,
    )
    return remember(memory, given, driven.world.detector, fused.scored_as, fused.known)


class Rehearsal:
    """A drive where everything arrives, frame by frame: what an ego asks about because of what it
    remembers, and whom it cannot place. What does not arrive hardly changes where objects are, or
    what poses are off by."""

    def __init__(self, driven: Driven, max_error_m: float) -> None:
        self._driven = driven
        self._max_error_m = max_error_m
        self._memory = Memory.of_detector(driven.world.detector)
        self._known: deque[Remembered] = deque(maxlen=LAG_FRAMES)
        self._shown: set[str] = set()
        self.placed: Mapping[str, bool] = {}
        """Of those that the newest frame asked for everything: whether that was fused."""

    def ask(
        self, frame: int, whole: Asked, about: Asked, objects: Collection[str] = ()
    ) -> dict[str, Focus]:
        """Who is asked about what in the next frame, of those who are not asked for everything:
        about places, none of whom the ego has not got a whole scan yet, and nobody where nothing is
        remembered. `whole`: who contributes, those of `objects` only what may be one; `about`: who
        would be asked about places."""
        driven, known, world = self._driven, self._known, self._driven.world
        here = world.pose(driven.ego, frame).matrix()
        enough = len(known) == LAG_FRAMES
        places = places_of(known[0], LAG_FRAMES / world.rate_hz, here) if enough else b""
        robots = [robot for robot in about if places and robot in self._shown]
        asked = (*whole, *robots)
        without_outline = all(driven.knows_pose(robot, frame) for robot in asked)
        only = dict.fromkeys(robots, Focus(places, without_outline))
        if enough:
            only |= {robot: OBJECTS for robot in whole if robot in objects}
        forms = {robot: about[robot] for robot in robots}
        fused = driven.fused(frame, {**whole, **forms}, self._max_error_m, only)
        self.placed = {robot: robot in fused.helpers for robot in whole}
        self._shown |= whole.keys()
        taken(self._memory, driven, frame, fused)
        known.append(suspected(self._memory, fused.known))
        return only
