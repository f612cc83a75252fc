"""One frame's corrections of senders' poses at the ego."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.fusion.alignment import Field, align
from perception.fusion.outline import standing
from perception.types import clean_points
from swarm.geometry import Matrix, Points


class Aligner:
    """Lays senders over the ego's own scan, float32 (N, 3) in its frame."""

    def __init__(self, own: Points) -> None:
        self._own = own
        self._field: Field | None = None

    def prepare(self) -> None:
        """Does what needs no sender."""
        if self._field is None:
            self._field = Field.of(standing(clean_points(self._own)))

    def correct(self, places: NDArray[np.float64], own_from_sender: Matrix) -> Matrix:
        """The correction, 4 x 4 in the ego's frame, of a sender with this outline (N, 2) in its own
        frame, metres; the identity where nothing better can be told.

        Raises PayloadError for a sender that does not align.
        """
        self.prepare()
        assert self._field is not None
        there = places @ own_from_sender[:2, :2].T + own_from_sender[:2, 3]
        return align(self._field, there, own_from_sender[:2, 3])
