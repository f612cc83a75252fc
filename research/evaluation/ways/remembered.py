"""What the ego of a drive remembers, and what it asks about because of that."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from perception.detector.config import configuration
from perception.memory.asking import places_of
from perception.memory.memory import Frame, Memory, Remembered
from perception.memory.remembering import held, remember
from perception.memory.reprocessing import ReprocessingMemory
from research.evaluation.ways.drive import Driven, FusedOnce

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
    )
    return remember(memory, given, driven.world.detector, fused.scored_as, fused.known)


def places_by_frame(
    driven: Driven, whole: Sequence[Asked], about: Sequence[Asked], max_error_m: float
) -> list[bytes]:
    """The places that the ego asks about in each frame of a drive; empty where nothing is
    remembered yet. `whole`: who is asked for everything in each frame, `about`: who about places.
    By what is remembered where everything arrives: what does not hardly changes where objects are.
    """
    world = driven.world
    memory = Memory(configuration(world.detector).usual_speed_m_s)
    known: deque[Remembered] = deque(maxlen=LAG_FRAMES)
    found = []
    for number, frame in enumerate(driven.frames):
        here = world.pose(driven.ego, frame).matrix()
        enough = len(known) == LAG_FRAMES and about[number]
        places = places_of(known[0], LAG_FRAMES / world.rate_hz, here) if enough else b""
        found.append(places)
        asked = {**whole[number], **(about[number] if places else {})}
        only = dict.fromkeys(about[number], places) if places else {}
        fused = driven.fused(frame, asked, max_error_m, only)
        taken(memory, driven, frame, fused)
        known.append(held(memory, fused.known))
    return found
