"""Correcting a sender's pose before fusing: what both see must lie in one place.

Poses come from the robots' own localisation and err by decimetres. The sender's outline is laid
over the ego's: of all small shifts and turns about the sender, the mean of those around the
likeliest one, given how well the outlines agree (a likelihood field: Thrun, Burgard and Fox,
"Probabilistic Robotics", 2005, 6.4) and how far poses usually err.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from perception.kernels.library import places as loops
from perception.kernels.library import pointer
from swarm.errors import PayloadError
from swarm.geometry import Matrix, yaw_of

Floats = NDArray[np.float64]

CELL_M = 0.15
REACH_M = 48.45
"""Half of the field's side: an outline's reach and a border that stays empty, to which everything
beyond is counted."""
SPREAD_M = 0.15
"""Distance at which a place agrees less, one standard deviation."""
SPREAD_CELLS = 3
"""Farther away it does not agree at all."""
PRIOR_SHIFT_M = 0.5
PRIOR_TURN_RAD = np.radians(0.6)
"""What poses usually err by, one standard deviation an axis."""
STRAY = 0.1
"""Likelihood of a point that the ego does not see."""
INDEPENDENT = 0.3
"""Points of one wall tell the same: so much does each count."""
SHIFT_CELLS = 11
"""The first search shifts by whole cells, this many each way."""
BORDER = 2 * SHIFT_CELLS + 1
TURNS_RAD = np.radians(np.arange(-1.8, 1.81, 0.6))
FINE_SHIFTS_M = np.arange(-0.12, 0.121, 0.04)
FINE_TURNS_RAD = np.radians(np.arange(-0.45, 0.451, 0.15))
PRIOR = np.diag(np.square([PRIOR_SHIFT_M, PRIOR_SHIFT_M, PRIOR_TURN_RAD]))
MIN_GAIN = 2.0
"""By how much a correction's log likelihood must exceed that of none, unless told otherwise."""
STILL_M = 0.02
STILL_RAD = np.radians(0.06)
"""Smaller corrections are within the outlines' own error."""
MIN_POINTS = 40
"""Fewer show too little: two sides of one car, each seen by one of two, fit in many ways."""
NEAR_M = 12.0
MIN_AGREEMENT = 0.25
"""A sender this near whose outline agrees less with the ego's is not where it says."""


_NEAR = np.array(
    [
        np.exp(-0.5 * (step * CELL_M / SPREAD_M) ** 2)
        for step in range(-SPREAD_CELLS, SPREAD_CELLS + 1)
    ]
).astype(np.float32)
_MARK = np.outer(_NEAR, _NEAR)
_LOG_MARK = np.log(STRAY + _MARK)
_NOTHING = np.log(np.float32(STRAY))
"""What a place adds to the cells around it, and to the logarithm of an empty field."""


@dataclass(frozen=True, slots=True)
class Field:
    """How likely something stands at each place around the ego."""

    likelihood: NDArray[np.float32]
    """(rows, columns) in 0 to 1; cells of CELL_M from -REACH_M on."""
    log: NDArray[np.float32]
    """(rows, columns): log of STRAY more, for sums over places."""

    @classmethod
    def of(cls, places: NDArray[np.floating]) -> Field:
        """The field of everything that stands, (N, 2) metres."""
        side = round(2 * REACH_M / CELL_M)
        field = cls(np.zeros((side, side), np.float32), np.full((side, side), _NOTHING))
        return field._with(places)

    def and_of(self, places: NDArray[np.floating]) -> Field:
        """This field and that of more places together."""
        return Field(self.likelihood.copy(), self.log.copy())._with(places)

    def _with(self, places: NDArray[np.floating]) -> Field:
        """`and_of`, which may change this field."""
        side = len(self.likelihood)
        column, row = np.floor((places + REACH_M) / CELL_M).astype(np.int64).T
        inside = (column >= 0) & (column < side) & (row >= 0) & (row < side)
        used = np.zeros(side * side, dtype=np.bool_)
        used[row[inside] * side + column[inside]] = True
        cells = np.flatnonzero(used)
        compiled = loops()
        if compiled is not None:
            row, column = np.divmod(cells, side)
            compiled.stamp(
                *(pointer(self.likelihood), pointer(self.log), side, BORDER),
                *(pointer(row), pointer(column), len(cells)),
                *(pointer(_MARK), pointer(_LOG_MARK), SPREAD_CELLS),
            )
            return self
        image = np.zeros((side, side), dtype=np.float32)
        image.reshape(-1)[cells] = 1.0
        # The nearest place's Gaussian, one axis after the other: it is a product of both.
        image = np.ascontiguousarray(_spread(_spread(image).T).T)
        image[:BORDER] = image[-BORDER:] = 0.0
        image[:, :BORDER] = image[:, -BORDER:] = 0.0
        image = np.maximum(image, self.likelihood)
        return Field(image, np.log(STRAY + image))

    def at(self, places: Floats) -> NDArray[np.float32]:
        """The likelihood at places (..., 2); 0 beyond the field."""
        return self.likelihood.reshape(-1)[self.index(places)]

    def index(self, places: Floats, margin: int = 0) -> NDArray[np.intp]:
        """Where places (..., 2) lie in the flattened field; those beyond lie in its border,
        `margin` cells from the edge."""
        side = len(self.likelihood)
        cells = np.floor((places + REACH_M) / CELL_M).astype(np.intp)
        cells = np.clip(cells, margin, side - 1 - margin)
        flat: NDArray[np.intp] = cells[..., 1] * side + cells[..., 0]
        return flat


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """By what a sender's pose is off, as one frame shows it."""

    move: Floats
    """(3,): the correction's shift along x and y, metres, and turn about the sender, radians; the
    mean given how far poses usually err."""
    covariance: Floats
    """(3, 3), of the same."""
    gain: float
    """Log likelihood of the best move above that of none."""

    @classmethod
    def nothing(cls) -> Estimate:
        """What is known where too little is seen."""
        return cls(np.zeros(3), PRIOR, 0.0)

    def told(self, min_gain: float = MIN_GAIN) -> Floats:
        """The move (3,) where the evidence is enough and it is no error of the outlines' own;
        otherwise zeros."""
        return np.zeros(3) if self.gain < min_gain or small(self.move) else self.move

    def left_m(self, by: Floats) -> float:
        """By how much the sender is still off, once it was corrected by this move (3,): the root of
        the mean square of the distance, metres."""
        off = self.move[:2] - by[:2]
        return float(np.sqrt(np.trace(self.covariance[:2, :2]) + off @ off))


def small(move: Floats) -> bool:
    """Whether a move (3,) is within the outlines' own error."""
    return bool(np.hypot(move[0], move[1]) < STILL_M and abs(move[2]) < STILL_RAD)


def correction(move: Floats, sender: Floats) -> Matrix:
    """The move (3,) of a sender at (2,) as a 4 x 4 matrix in the same frame."""
    x, y, turn = move
    matrix = np.eye(4)
    cos, sin = np.cos(turn), np.sin(turn)
    matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    matrix[:2, 3] = sender + np.array([x, y]) - matrix[:2, :2] @ sender
    return matrix


def move_of(by: Matrix, sender: Floats) -> tuple[float, float, float]:
    """The other way round: by what a 4 x 4 matrix moves a sender at (2,), x, y and turn."""
    x, y = (by[:2, :2] @ sender + by[:2, 3] - sender).tolist()
    return x, y, yaw_of(by)


def estimate(field: Field, places: Floats, sender: Floats) -> Estimate:
    """By what a sender is off that believes to stand at `sender` (2,) and to see `places` (N, 2),
    metres in the ego's frame.

    Raises PayloadError for a sender near the ego whose outline agrees with the ego's nowhere.
    """
    if len(places) < MIN_POINTS or not field.likelihood.any():
        return Estimate.nothing()
    around = places - sender
    still = _score(field, around, sender, np.zeros((1, 3)))[0]
    best, roughly = _coarse(field, around, sender)
    fine = best + _fine_moves()
    scores = _score(field, around, sender, fine)
    # The mean of what is likely errs less than the likeliest.
    move, closely = _moments(fine, scores)
    agreement = float(field.at(_moved(around, sender, move[None])[0]).mean())
    if np.hypot(*sender) < NEAR_M and agreement < MIN_AGREEMENT:
        raise PayloadError(
            f"the contribution does not align: from {np.hypot(*sender):.1f} m away, its outline "
            f"agrees with the ego's to {agreement:.2f}; at least {MIN_AGREEMENT} is needed"
        )
    return Estimate(move, closely + roughly, float(scores.max() - still))


def _moments(moves: Floats, scores: Floats) -> tuple[Floats, Floats]:
    """Mean (3,) and covariance (3, 3) of moves (K, 3) with these log likelihoods."""
    weights = np.exp(scores - scores.max())
    mean: Floats = weights @ moves / weights.sum()
    off = moves - mean
    return mean, (off * weights[:, None]).T @ off / weights.sum()


def _spread(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Each row's largest value about every cell, weighed by its distance."""
    spread = image.copy()
    for step in range(1, SPREAD_CELLS + 1):
        weighed = image * np.float32(np.exp(-0.5 * (step * CELL_M / SPREAD_M) ** 2))
        np.maximum(spread[:, step:], weighed[:, :-step], out=spread[:, step:])
        np.maximum(spread[:, :-step], weighed[:, step:], out=spread[:, :-step])
    return spread


def _coarse(field: Field, around: Floats, sender: Floats) -> tuple[Floats, Floats]:
    """The likeliest turn and shift (x, y, turn) of whole cells, and the covariance of all."""
    moves, prior = _coarse_moves()
    turned = np.zeros((len(TURNS_RAD), 3))
    turned[:, 2] = TURNS_RAD
    base = field.index(_moved(around, sender, turned), margin=SHIFT_CELLS)
    side, sets, wide = len(field.log), len(TURNS_RAD), 2 * SHIFT_CELLS + 1
    compiled = loops()
    if compiled is not None:
        base = np.ascontiguousarray(base, dtype=np.int64)
        sums = np.empty((sets, wide, wide), dtype=np.float32)
        compiled.sum_shifted(
            *(pointer(field.log), side, pointer(base), sets, base.shape[1], SHIFT_CELLS),
            pointer(sums),
        )
    else:
        row, column = np.divmod(base, side)
        # Of each place all shifts at once: whole rows of the field are read faster than cells.
        shifted = sliding_window_view(field.log, (wide, wide))
        sums = shifted[row - SHIFT_CELLS, column - SHIFT_CELLS].sum(axis=1)
    scores = sums.transpose(2, 1, 0).reshape(-1) * INDEPENDENT + prior
    return moves[int(scores.argmax())], _moments(moves, scores)[1]


@cache
def _coarse_moves() -> tuple[Floats, Floats]:
    """All turns and shifts of whole cells (K, 3), and how likely they are by themselves (K,)."""
    shifts = np.arange(-SHIFT_CELLS, SHIFT_CELLS + 1).astype(np.float64) * CELL_M
    moves = _grid(shifts, shifts, TURNS_RAD)
    return moves, _prior(moves)


@cache
def _fine_moves() -> Floats:
    return _grid(FINE_SHIFTS_M, FINE_SHIFTS_M, FINE_TURNS_RAD)


def _grid(x: Floats, y: Floats, turns: Floats) -> Floats:
    """(K, 3): all shifts along x and y with all turns, turns fastest."""
    mesh = np.meshgrid(x, y, turns, indexing="ij")
    return np.column_stack([part.ravel() for part in mesh])


def _moved(around: Floats, sender: Floats, moves: Floats) -> Floats:
    """(K, N, 2): places around the sender under K moves about it."""
    cos, sin = np.cos(moves[:, 2:]), np.sin(moves[:, 2:])
    x, y = around.T
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return turned + (sender + moves[:, :2])[:, None]


def _score(field: Field, around: Floats, sender: Floats, moves: Floats) -> Floats:
    """Log likelihood of K moves, up to a constant."""
    compiled = loops()
    if compiled is not None:
        sums = np.empty(len(moves), dtype=np.float32)
        turned = np.column_stack([moves[:, :2], np.cos(moves[:, 2]), np.sin(moves[:, 2])])
        around, center = np.ascontiguousarray(around), np.ascontiguousarray(sender)
        compiled.sum_moved(
            *(pointer(field.log), len(field.log), CELL_M, REACH_M, pointer(around), len(around)),
            *(pointer(center), pointer(turned), len(moves), pointer(sums)),
        )
    else:
        sums = field.log.reshape(-1)[field.index(_moved(around, sender, moves))].sum(axis=1)
    score: Floats = sums * INDEPENDENT + _prior(moves)
    return score


def _prior(moves: Floats) -> Floats:
    """Log likelihood of errors (K, 3) by themselves, up to a constant."""
    shift = (moves[:, :2] ** 2).sum(axis=1) / PRIOR_SHIFT_M**2
    prior: Floats = -0.5 * (shift + (moves[:, 2] / PRIOR_TURN_RAD) ** 2)
    return prior
