"""One frame's corrections of senders' poses at the ego."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from perception.fusion.alignment import Estimate, Field, correction, estimate, move_of
from perception.fusion.lines import Lines
from perception.fusion.outline import standing
from perception.types import clean_points
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points, invert

Floats = NDArray[np.float64]

SETTLED_AGREEMENT = 0.25
"""A sender whose outline agrees this much with what the ego sees itself is in its place. The others
see other parts of the floor, which those who are settled show, too."""
SECOND_HAND_GAIN = 3.0
"""What others show, or little of what the ego sees, is weaker evidence: see `align`."""
PLACED_M = 0.14
"""A sender that may be farther off than this (root of the mean square) is not known to be where it
says: what it shows lies beside what others show. Set on floors of the seeds from 3,951,000 on."""


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of one sender from the frames before and this one."""

    correction: Matrix
    """4 x 4 in the ego's frame."""
    left_m: float
    """By how much it is still off then, root of the mean square."""


class Corrections(Protocol):
    """What is known of senders from the frames before, at the time of one frame."""

    def corrected(self, robot: str, own_from_sender: Matrix, shown: Estimate) -> Known | None:
        """The correction by all that was shown until now; None where this frame is to speak for
        itself."""
        ...

    def usual_m(self) -> float | None:
        """By how much poses are usually off, root of the mean square, after all senders of the
        frame were asked for; None where this frame is to speak for itself."""
        ...


@dataclass(frozen=True, slots=True)
class Held:
    """`Corrections` that were found before: they count whatever the frame shows."""

    in_world: Mapping[str, Matrix]
    """4 x 4 in the world frame, by robot."""
    world_from_own: Matrix

    def corrected(self, robot: str, own_from_sender: Matrix, shown: Estimate) -> Known | None:
        """See `Corrections.corrected`."""
        found = self.in_world.get(robot)
        if found is None:
            return None
        return Known(invert(self.world_from_own) @ found @ self.world_from_own, 0.0)

    def usual_m(self) -> None:
        """See `Corrections.usual_m`."""
        return None


class Remembering(Protocol):
    """What is known of senders from frame to frame."""

    def at(self, time_s: float, stood_s: float, world_from_own: Matrix) -> Corrections:
        """For what was captured at that time, and an ego that stands there at `stood_s`: seconds of
        one clock. Any thread may ask."""
        ...


@dataclass(slots=True)
class _Sender:
    robot: str
    own_from_sender: Matrix
    there: Floats
    """Where it believes to see its outline (N, 2)."""
    shown: Estimate
    correction: Matrix
    settled: bool
    known: Known | None = None

    @property
    def stands(self) -> Floats:
        """Where it believes to stand (2,)."""
        return self.own_from_sender[:2, 3]

    def left_m(self) -> float:
        """By how much it may still be off."""
        if self.known is not None:
            return self.known.left_m
        return self.shown.left_m(np.array(move_of(self.correction, self.stands)))

    def shift_m(self) -> float:
        """By how much it was off before."""
        move = self.shown.move
        if self.known is not None:
            move = np.array(move_of(self.known.correction, self.stands))
        return math.hypot(*move[:2])


class Aligner:
    """Lays senders over the ego's own scan, float32 (N, 3) in its frame, and over each other."""

    def __init__(self, own: Points) -> None:
        self._own = own
        self._field: Field | None = None
        self._lines: Lines | None = None
        self._senders: list[_Sender] = []
        self._done = False
        self._usual_m: float | None = None

    def prepare(self) -> None:
        """Does what needs no sender."""
        if self._field is None:
            places = standing(clean_points(self._own))
            self._field, self._lines = Field.of(places), Lines(places)
            self._lines.prepare()

    def add(self, places: Floats, own_from_sender: Matrix, robot: str = "") -> None:
        """A sender with this outline (N, 2), metres in its own frame.

        Raises PayloadError for one that does not align, which counts as never added.
        """
        self.prepare()
        assert self._field is not None
        assert self._lines is not None
        there = _moved(places, own_from_sender)
        stands = own_from_sender[:2, 3]
        shown = self._lines.refine(estimate(self._field, there, stands), there, stands)
        found = correction(shown.told(), stands)
        here = _moved(there, found)
        settled = len(here) > 0 and float(self._field.at(here).mean()) >= SETTLED_AGREEMENT
        if not settled:
            found = correction(shown.told(SECOND_HAND_GAIN), stands)
        self._senders.append(_Sender(robot, own_from_sender, there, shown, found, settled))

    def corrections(self, remembered: Corrections | None = None) -> list[Matrix]:
        """The corrections, 4 x 4 in the ego's frame, in the order of `add`; the identity where
        nothing better can be told. `remembered`: what the frames before showed, which counts when
        they are asked for first."""
        self._decide(remembered)
        return [one.correction for one in self._senders]

    def unplaced(self) -> dict[int, str]:
        """Senders that may be farther off than PLACED_M, by number in the order of `add`, with
        why: where those whose error shows were off by more than that, too. After
        `corrections`."""
        if self._usual_m is None or self._usual_m <= PLACED_M:
            return {}
        left = [min(one.left_m(), self._usual_m) for one in self._senders]
        return {
            number: f"what it sees does not show where it is: it may be off by {off_m:.2f} m, as "
            f"others are by {self._usual_m:.2f} m; allowed: {PLACED_M}"
            for number, off_m in enumerate(left)
            if off_m > PLACED_M
        }

    def _decide(self, remembered: Corrections | None) -> None:
        if self._done:
            return
        self._done = True
        settled = [one for one in self._senders if one.settled]
        others = [one for one in self._senders if not one.settled]
        shown = [one for one in others if len(one.there)]
        _remember(settled, remembered)
        if settled and shown:
            self._lay_over(shown, settled)
        _remember(others, remembered)
        self._usual_m = None if remembered is None else remembered.usual_m()
        if self._usual_m is None:
            self._usual_m = usual(
                [one.shift_m() for one in self._senders if one.left_m() <= PLACED_M]
            )

    def _lay_over(self, others: Sequence[_Sender], settled: Sequence[_Sender]) -> None:
        """Lays senders over what the ego and the settled ones show together."""
        assert self._field is not None
        assert self._lines is not None
        shown = np.concatenate([_moved(one.there, one.correction) for one in settled])
        field, lines = self._field.and_of(shown), self._lines.and_of(shown)
        for one in others:
            try:
                rough = estimate(field, one.there, one.stands)
            except PayloadError:
                # It was let in by what the ego sees itself, and the others may err.
                continue
            one.shown = lines.refine(rough, one.there, one.stands)
            move = one.shown.told(SECOND_HAND_GAIN)
            if move.any():
                one.correction = correction(move, one.stands)


def _remember(senders: Sequence[_Sender], remembered: Corrections | None) -> None:
    """Takes what was known before into account, and lets what is shown be known from now on."""
    if remembered is None:
        return
    for one in senders:
        one.known = remembered.corrected(one.robot, one.own_from_sender, one.shown)
        if one.known is not None:
            one.correction = one.known.correction


def usual(shifts_m: Sequence[float]) -> float | None:
    """By how much poses are usually off, root of the mean square, where some were by so much; None
    where none was. From the median, as for a normal error along each of two axes: one sender that
    was laid over the wrong wall says little of the others.

    >>> usual([0.2, 0.2, 0.2, 1.0])
    0.24022448175729
    """
    return float(np.median(shifts_m)) / math.sqrt(math.log(2.0)) if shifts_m else None


def in_world(
    aligner: Aligner | None, robots: Sequence[str], world_from_own: Matrix
) -> dict[str, Matrix]:
    """The aligner's corrections in the world frame, by robot in the order of `add`."""
    if aligner is None:
        return {}
    own_from_world = invert(world_from_own)
    return {
        robot: world_from_own @ by @ own_from_world
        for robot, by in zip(robots, aligner.corrections(), strict=True)
    }


def _moved(places: Floats, by: Matrix) -> Floats:
    moved: Floats = places @ by[:2, :2].T + by[:2, 3]
    return moved
