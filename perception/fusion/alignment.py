"""Correcting a sender's pose before fusing: what both see must lie in one place.

Poses come from the robots' own localisation and err by decimetres. The sender's outline is laid
over the ego's: of all small shifts and turns about the sender, the likeliest one, given how well
the outlines agree (a likelihood field: Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, 6.4)
and how far poses usually err.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm.errors import PayloadError
from swarm.geometry import Matrix

Floats = NDArray[np.float64]

CELL_M = 0.15
REACH_M = 45.0
SPREAD_M = 0.15
"""Distance at which two outlines agree less, one standard deviation."""
PRIOR_SHIFT_M = 0.5
PRIOR_TURN_RAD = np.radians(0.6)
"""What poses usually err by, one standard deviation an axis."""
STRAY = 0.1
"""Likelihood of a point that the ego does not see."""
INDEPENDENT = 0.3
"""Points of one wall tell the same: so much does each count."""
SHIFTS_M = np.arange(-1.6, 1.61, 0.2)
TURNS_RAD = np.radians(np.arange(-1.8, 1.81, 0.6))
FINE_SHIFTS_M = np.arange(-0.16, 0.161, 0.04)
FINE_TURNS_RAD = np.radians(np.arange(-0.45, 0.451, 0.15))
MIN_GAIN = 2.0
"""By how much a correction's log likelihood must exceed that of none."""
STILL_M = 0.08
STILL_RAD = np.radians(0.25)
"""Smaller corrections are within the outlines' own error."""
MIN_POINTS = 40
"""Fewer show too little: two sides of one car, each seen by one of two, fit in many ways."""
NEAR_M = 12.0
MIN_AGREEMENT = 0.12
"""A sender this near whose outline agrees less with the ego's is not where it says."""


@dataclass(frozen=True, slots=True)
class Field:
    """How likely something stands at each place around the ego."""

    likelihood: Floats
    """(rows, columns) in 0 to 1; cells of CELL_M from -REACH_M on."""

    @classmethod
    def of(cls, places: Floats) -> Field:
        """The field of an outline (N, 2), metres."""
        from scipy.ndimage import distance_transform_edt

        side = round(2 * REACH_M / CELL_M)
        free = np.ones((side, side), dtype=np.bool_)
        column, row = np.floor((places + REACH_M) / CELL_M).astype(np.intp).T
        inside = (column >= 0) & (column < side) & (row >= 0) & (row < side)
        free[row[inside], column[inside]] = False
        if free.all():
            return cls(np.zeros((side, side)))
        distance = distance_transform_edt(free) * CELL_M
        return cls(np.exp(-0.5 * (distance / SPREAD_M) ** 2))

    def at(self, places: Floats) -> Floats:
        """The likelihood at places (..., 2); 0 beyond the field."""
        side = len(self.likelihood)
        index = np.floor((places + REACH_M) / CELL_M).astype(np.intp)
        inside = ((index >= 0) & (index < side)).all(axis=-1)
        index = np.clip(index, 0, side - 1)
        return np.where(inside, self.likelihood[index[..., 1], index[..., 0]], 0.0)


def align(field: Field, places: Floats, sender: Floats) -> Matrix:
    """The correction, 4 x 4 in the ego's frame, of a sender that believes to stand at `sender` (2,)
    and to see `places` (N, 2), metres; the identity where nothing better can be told.

    Raises PayloadError for a sender near the ego whose outline agrees with the ego's nowhere.
    """
    if len(places) < MIN_POINTS or not field.likelihood.any():
        return np.eye(4)
    around = places - sender
    still = _score(field, around, sender, np.zeros((1, 3)))[0]
    coarse = _grid(np.zeros(3), SHIFTS_M, TURNS_RAD)
    best = coarse[int(_score(field, around, sender, coarse).argmax())]
    fine = _grid(best, FINE_SHIFTS_M, FINE_TURNS_RAD)
    scores = _score(field, around, sender, fine)
    x, y, turn = fine[int(scores.argmax())]
    moved = _moved(around, sender, np.array([[x, y, turn]]))[0]
    agreement = float(field.at(moved).mean())
    if np.hypot(*sender) < NEAR_M and agreement < MIN_AGREEMENT:
        raise PayloadError(
            f"the contribution does not align: from {np.hypot(*sender):.1f} m away, its outline "
            f"agrees with the ego's to {agreement:.2f}; at least {MIN_AGREEMENT} is needed"
        )
    small = np.hypot(x, y) < STILL_M and abs(turn) < STILL_RAD
    if small or scores.max() - still < MIN_GAIN:
        return np.eye(4)
    matrix = np.eye(4)
    cos, sin = np.cos(turn), np.sin(turn)
    matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    matrix[:2, 3] = sender + np.array([x, y]) - matrix[:2, :2] @ sender
    return matrix


def _grid(middle: Floats, shifts: Floats, turns: Floats) -> Floats:
    """(K, 3): shifts along x and y, and turns, around a middle."""
    x, y, turn = np.meshgrid(shifts, shifts, turns, indexing="ij")
    return middle + np.column_stack([x.ravel(), y.ravel(), turn.ravel()])


def _moved(around: Floats, sender: Floats, moves: Floats) -> Floats:
    """(K, N, 2): places around the sender under K moves about it."""
    cos, sin = np.cos(moves[:, 2:]), np.sin(moves[:, 2:])
    x, y = around.T
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return turned + (sender + moves[:, :2])[:, None]


def _score(field: Field, around: Floats, sender: Floats, moves: Floats) -> Floats:
    """Log likelihood of K moves, up to a constant."""
    seen = field.at(_moved(around, sender, moves))
    likely = np.log(STRAY + seen).sum(axis=1) * INDEPENDENT
    prior = (moves[:, :2] ** 2).sum(axis=1) / PRIOR_SHIFT_M**2 + (moves[:, 2] / PRIOR_TURN_RAD) ** 2
    score: Floats = likely - 0.5 * prior
    return score
