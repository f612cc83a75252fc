"""One frame's corrections of senders' poses at the ego."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from perception.fusion.alignment import Field, align
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


class Aligner:
    """Lays senders over the ego's own scan, float32 (N, 3) in its frame, and over each other."""

    def __init__(self, own: Points) -> None:
        self._own = own
        self._field: Field | None = None
        self._senders: list[tuple[Floats, Floats]] = []
        """Of each: where it believes to see its outline and to stand itself."""
        self._corrections: list[Matrix] = []
        self._unsettled: list[int] = []

    def prepare(self) -> None:
        """Does what needs no sender."""
        if self._field is None:
            self._field = Field.of(standing(clean_points(self._own)))

    def add(self, places: Floats, own_from_sender: Matrix) -> None:
        """A sender with this outline (N, 2), metres in its own frame.

        Raises PayloadError for one that does not align, which counts as never added.
        """
        self.prepare()
        assert self._field is not None
        there = _moved(places, own_from_sender)
        sender = own_from_sender[:2, 3]
        correction = align(self._field, there, sender)
        here = _moved(there, correction)
        agreement = float(self._field.at(here).mean()) if len(here) else 0.0
        if agreement < SETTLED_AGREEMENT:
            self._unsettled.append(len(self._senders))
            correction = align(self._field, there, sender, SECOND_HAND_GAIN)
        self._senders.append((there, sender))
        self._corrections.append(correction)

    def corrections(self) -> list[Matrix]:
        """The corrections, 4 x 4 in the ego's frame, in the order of `add`; the identity where
        nothing better can be told."""
        settled = [
            _moved(there, correction)
            for i, ((there, _), correction) in enumerate(
                zip(self._senders, self._corrections, strict=True)
            )
            if i not in self._unsettled
        ]
        if not settled or not self._unsettled:
            return self._corrections
        assert self._field is not None
        field = self._field.and_of(np.concatenate(settled))
        for i in self._unsettled:
            try:
                found = align(field, *self._senders[i], SECOND_HAND_GAIN)
            except PayloadError:
                # It was let in by what the ego sees itself, and the others may err.
                continue
            if not np.array_equal(found, np.eye(4)):
                self._corrections[i] = found
        self._unsettled.clear()
        return self._corrections


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
