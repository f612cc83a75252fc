"""What the ego of a drive remembers, and what it asks about because of that."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from perception.detector.config import configuration
from perception.memory.asking import places_of
from perception.memory.memory import Frame, Memory, Remembered
from perception.memory.remembering import remember, suspected
from perception.memory.reprocessing import ReprocessingMemory
from research.evaluation.ways.drive import Driven, Focus, FusedOnce

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
    )
    return remember(memory, given, driven.world.detector, fused.scored_as, fused.known)


def places_by_frame(
    driven: Driven, whole: Sequence[Asked], about: Sequence[Asked], max_error_m: float
) -> list[dict[str, Focus]]:
    """Who is asked about which places in each frame of a drive, as an ego does: none of whom it has
    not got a whole scan yet, and nobody where nothing is remembered. `whole`: who is asked for
    everything in each frame, `about`: who would be about places. By what is remembered where
    everything arrives: what does not hardly changes where objects are, or what poses are off by.
    """
    world = driven.world
    memory = Memory(configuration(world.detector).usual_speed_m_s)
    known: deque[Remembered] = deque(maxlen=LAG_FRAMES)
    shown: set[str] = set()
    found = []
    for number, frame in enumerate(driven.frames):
        here = world.pose(driven.ego, frame).matrix()
        enough = len(known) == LAG_FRAMES
        places = places_of(known[0], LAG_FRAMES / world.rate_hz, here) if enough else b""
        robots = [robot for robot in about[number] if places and robot in shown]
        asked = (*whole[number], *robots)
        without_outline = all(driven.knows_pose(robot, frame) for robot in asked)
        only = dict.fromkeys(robots, Focus(places, without_outline))
        found.append(only)
        forms = {robot: about[number][robot] for robot in only}
        fused = driven.fused(frame, {**whole[number], **forms}, max_error_m, only)
        shown |= whole[number].keys()
        taken(memory, driven, frame, fused)
        known.append(suspected(memory, fused.known))
    return found
