"""What ways bring on a drive."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from perception.fusion.publishing import publish
from perception.memory.memory import Memory
from perception.memory.reprocessing import ReprocessingMemory
from perception.tally import Tally
from perception.types import Boxes
from research.evaluation.ways.drive import Driven, FusedOnce
from research.evaluation.ways.going import gone
from research.evaluation.ways.remembered import taken
from research.evaluation.ways.tracking import NEAR_M, Following
from research.evaluation.ways.way import Way
from worlds.base import World
from worlds.cooperative.judging import judge, judge_with_known

SETTLED_FRAMES = 10
"""From the first that counts: a memory begins empty."""


@dataclass(slots=True)
class Measured:
    """What one way brought on one drive, or on several."""

    tally: Tally = field(default_factory=Tally)
    following: Following = field(default_factory=Following)
    bytes: int = 0
    """That robots sent, requests included."""
    wanted_bytes: int = 0
    """The same of all that was asked for, sent or not."""
    asked: int = 0
    came: int = 0
    """Of these contributions, those that were there in time."""
    taking_part: int = 0
    """Robots that the frames' decisions name, the ego apart."""
    due: int = 0
    """Frames, fused or skipped."""
    ego_ms: float = 0.0
    """The ego's work, by the model of compute."""
    helping_ms: float = 0.0
    """What of that is for contributions, and the work of the robots that sent them."""
    memory_ms: list[float] = field(default_factory=list)
    lost: int = 0
    """Objects that were told of, and then shown by nobody until a silence ended..."""
    found_again: int = 0
    """...and of these those whose place was right then."""

    def take_up(self, other: Measured, drive: int) -> None:
        """Adds another drive."""
        self.tally.take_up(other.tally)
        self.following.take_up(other.following, drive)
        self.bytes += other.bytes
        self.wanted_bytes += other.wanted_bytes
        self.asked += other.asked
        self.came += other.came
        self.taking_part += other.taking_part
        self.due += other.due
        self.ego_ms += other.ego_ms
        self.helping_ms += other.helping_ms
        self.memory_ms += other.memory_ms
        self.lost += other.lost
        self.found_again += other.found_again


class Watching(Protocol):
    """Whoever looks at the frames that count, too."""

    def add(
        self, world: World, frame: int, told: Boxes, truth: Boxes, names: Sequence[str]
    ) -> None:
        """A frame: the boxes that count, told and true, and whose the true ones are."""
        ...


def measure(driven: Driven, way: Way, watching: Watching | None = None) -> Measured:
    """Drives the way."""
    world, measured = driven.world, Measured()
    detector = world.detector
    kind = ReprocessingMemory if way.late_frames else Memory
    memory = kind.of_detector(detector) if way.memory else None
    silence = Silence(measured)
    going = gone(driven, way)
    for number, (frame, now) in enumerate(zip(driven.frames, going, strict=True)):
        settled = number >= SETTLED_FRAMES
        measured.due += settled
        if now is None:
            continue
        came = now.came
        fused = (
            driven.fused(frame, {}, way.max_error_m)
            if way.late_frames
            else driven.fused(frame, came, way.max_error_m, now.places)
        )
        shown = _published(fused, detector)
        told, tracks = shown, np.arange(len(shown)) + number * 1000
        if memory is not None:
            begun = time.perf_counter()
            before = number - way.late_frames
            if way.late_frames and before >= 0 and (then := going[before]) is not None:
                late = driven.fused(driven.frames[before], then.came, way.max_error_m)
                taken(memory, driven, driven.frames[before], late)
            remembered = taken(memory, driven, frame, fused)
            measured.memory_ms.append((time.perf_counter() - begun) * 1e3)
            assert remembered is not None, "only calibrated algorithms are measured"
            told, tracks = remembered.boxes, remembered.ids
        if not settled:
            continue
        found, truth = judge(world, frame, driven.ego, told)
        with_known = judge_with_known(world, frame, driven.ego, told, fused.known)
        measured.tally.add(found, truth, now.sizes, with_known)
        measured.bytes += sum(now.sizes)
        measured.wanted_bytes += now.wanted_bytes
        measured.asked += now.asked
        measured.came += len(came)
        measured.taking_part += now.taking_part
        measured.ego_ms += now.ego_ms
        measured.helping_ms += now.helping_ms
        names = _names(world.ground_truth(frame).boxes, world.ground_truth(frame).ids, truth)
        if watching is not None:
            watching.add(world, frame, found, truth, names)
        kept = _rows(told, found)
        measured.following.add(found.centers[:, :2], tracks[kept], truth.centers[:, :2], names)
        if way.silent is not None:
            place = number % way.silent[0] - (way.silent[0] - way.silent[1])
            silence.add(
                place, way.silent[1], shown, told, dict(zip(names, truth.centers, strict=True))
            )
    return measured


def _published(fused: FusedOnce, detector: str) -> Boxes:
    """The frame's own boxes, as they are published."""
    return publish(fused.found, detector, fused.scored_as, len(fused.helpers), fused.known)


def _names(boxes: Boxes, ids: tuple[str, ...], some: Boxes) -> tuple[str, ...]:
    """Whose some of the boxes are."""
    return tuple(ids[i] for i in _rows(boxes, some))


def _rows(boxes: Boxes, some: Boxes) -> NDArray[np.intp]:
    """Where some of the boxes, in the same order, are among them."""
    same = (some.centers[:, None] == boxes.centers[None]).all(axis=2)
    return same.argmax(axis=1) if len(some) else np.zeros(0, dtype=np.intp)


class Silence:
    """Follows what becomes of objects while nobody sends."""

    def __init__(self, measured: Measured) -> None:
        self._measured = measured
        self._told: set[str] = set()
        self._shown: set[str] = set()

    def add(
        self,
        place: int,
        length: int,
        shown: Boxes,
        told: Boxes,
        truth: dict[str, NDArray[np.float64]],
    ) -> None:
        """A frame, so many after a silence of that length begins; -1: the last one before it."""
        if place == -1:
            self._told, self._shown = _near(told, truth), set()
            return
        if place < 0:
            return
        self._shown |= _near(shown, truth)
        if place == length - 1:
            lost = (self._told - self._shown) & truth.keys()
            self._measured.lost += len(lost)
            self._measured.found_again += len(lost & _near(told, truth))


def _near(boxes: Boxes, truth: dict[str, NDArray[np.float64]]) -> set[str]:
    """The objects that have a box within NEAR_M."""
    return {
        name
        for name, center in truth.items()
        if (np.hypot(*(boxes.centers[:, :2] - center[:2]).T) <= NEAR_M).any()
    }
