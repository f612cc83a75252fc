"""Frames of a world that follow each other, as an ego remembers them, without a network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from perception.fusion.base import Fusion
from perception.memory.memory import Frame, Remembered
from perception.memory.remembering import remember
from perception.memory.reprocessing import KEPT_S, ReprocessingMemory
from swarm.errors import PerceptionError
from worlds.base import World
from worlds.cooperative.fusing import SINGLE, Disturbance, Fused, fuse_frame

SETTLING_S = 1.0
"""What a memory tells of its first second, or of the first quarter of few frames, does not count:
it has seen too little."""


def remembered_frames(
    world: World,
    algorithm: str | Fusion,
    ego: str,
    disturbance: Disturbance | None = None,
    frames: Sequence[int] | None = None,
    rate_hz: float | None = None,
) -> Iterator[tuple[int, Fused]]:
    """The frames that count, with what the ego tells from memory in place of the frame's own boxes
    (`Detections.tracks` of a live ego), all robots taking part.

    All send `rate_hz` times a second (None: in every frame); what is late by `delay_s` is taken up
    when it comes, as a live ego does with what missed its frame's deadline. `bytes` are those of
    the frames that are sent.

    Raises PerceptionError for a rate that the world has not, for a delay beyond KEPT_S, and for an
    algorithm whose scores nobody has calibrated.
    """
    disturbance = disturbance or Disturbance()
    if disturbance.delay_s > KEPT_S:
        raise PerceptionError(
            f"contributions {disturbance.delay_s:g} s late are not remembered; "
            f"allowed: at most {KEPT_S:g}"
        )
    if rate_hz is not None and not 0.0 < rate_hz <= world.rate_hz:
        raise PerceptionError(
            f"rate {rate_hz:g} Hz is not allowed; allowed: above 0, at most {world.rate_hz:g}"
        )
    every = 1 if rate_hz is None else round(world.rate_hz / rate_hz)
    late = round(disturbance.delay_s * world.rate_hz)
    in_time = replace(disturbance, delay_s=0.0)
    memory = ReprocessingMemory.of_detector(world.detector)
    order = list(range(world.frame_count) if frames is None else frames)
    settling = min(round(SETTLING_S * world.rate_hz), len(order) // 4)

    def taken(frame: int, others: bool) -> tuple[Fused, Remembered]:
        robots = world.robots if others else ()
        by = algorithm if robots else SINGLE
        fused = fuse_frame(world, frame, ego, robots, by, in_time)
        scan = world.scan(ego, frame)
        here = scan.pose.matrix()
        given = Frame(
            frame / world.rate_hz,
            fused.found,
            frozenset(fused.bytes.keys() - fused.rejected.keys()),
            {ego: (scan.points, here), **fused.sent_points},
            here,
        )
        told = remember(memory, given, world.detector, by, fused.known)
        if told is None:
            raise PerceptionError(
                f"what {by if isinstance(by, str) else by.name!r} finds cannot be remembered: its "
                "scores are not calibrated; allowed: an algorithm that is (`coadapt train`)"
            )
        return fused, told

    for number, frame in enumerate(order):
        sent = late and number >= late and (number - late) % every == 0
        came = taken(order[number - late], True)[0].bytes if sent else {}
        fused, told = taken(frame, not late and number % every == 0)
        if number >= settling:
            yield frame, replace(fused, boxes=told.boxes, bytes={**fused.bytes, **came})
