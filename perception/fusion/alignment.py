"""Correcting a sender's pose before fusing: what both see must lie in one place.

Poses come from the robots' own localisation and err by decimetres. Landmarks, the middles of
objects that both the ego and the sender believe to see, give the turn and the shift that bring the
sender's over the ego's. The problem is small and its outliers are many, so hypotheses from pairs of
landmarks are scored by how many landmarks they bring together (Fischler and Bolles, 1981), and the
best one is refined with weights that fall with the distance (Geman and McClure, 1987).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm.errors import PayloadError
from swarm.geometry import Matrix

Floats = NDArray[np.float64]

MAX_SHIFT_M = 2.0
"""Poses that are farther off are not corrected: three standard deviations of a bad localisation."""
MAX_TURN_RAD = np.radians(3.0)
TOGETHER_M = 0.4
"""Landmarks this close after the correction count as one."""
SPREAD_M = 0.15
"""Error of a landmark's place, one standard deviation."""
PRIOR_SHIFT_M = 0.5
PRIOR_TURN_RAD = np.radians(0.5)
"""What poses usually err by: holds the correction where few landmarks are common."""
STILL_M = 0.12
"""Smaller corrections are within the landmarks' own error and are not made."""
MIN_LANDMARKS = 4
NEAR_M = 15.0
"""With this many landmarks each this near the ego, having none in common is a fault."""
ROUNDS = 8


@dataclass(frozen=True, slots=True)
class Alignment:
    """How a sender's frame was corrected."""

    corrected_from_claimed: Matrix
    """Turn and shift in the ego's ground plane, 4 x 4."""
    together: int
    """Landmarks that lie in one place afterwards."""


def align(own: Floats, theirs: Floats) -> Alignment:
    """The correction that brings landmarks (M, 2) of a sender over the ego's (N, 2), both in the
    ego's frame, metres. The identity where nothing can be told.

    Raises PayloadError where both have landmarks near the ego and none in common: then the sender
    is not where it says.
    """
    pairs = _pairs(own, theirs)
    if not len(pairs):
        if min(_near(own), _near(theirs)) >= MIN_LANDMARKS:
            raise PayloadError(
                f"the contribution does not align: none of its {_near(theirs)} objects near the "
                f"ego lies within {MAX_SHIFT_M:g} m of one of the ego's {_near(own)}"
            )
        return Alignment(np.eye(4), 0)
    start = _best_start(own, theirs, pairs)
    turn, shift = _refine(own, theirs, *start)
    moved = _apply(theirs, turn, shift)
    apart = np.linalg.norm(moved[:, None] - own[None], axis=2).min(axis=1)
    common = apart < TOGETHER_M
    if not common.any() or np.linalg.norm((moved - theirs)[common], axis=1).mean() < STILL_M:
        return Alignment(np.eye(4), int(common.sum()))
    return Alignment(_matrix(turn, shift), int(common.sum()))


def _near(landmarks: Floats) -> int:
    return int((np.hypot(*landmarks.T) < NEAR_M).sum()) if len(landmarks) else 0


def _pairs(own: Floats, theirs: Floats) -> NDArray[np.intp]:
    """(K, 2): indices of (theirs, own) that a pose error may have parted."""
    if not len(own) or not len(theirs):
        return np.zeros((0, 2), dtype=np.intp)
    apart = np.linalg.norm(theirs[:, None] - own[None], axis=2)
    return np.argwhere(apart <= MAX_SHIFT_M)


def _best_start(own: Floats, theirs: Floats, pairs: NDArray[np.intp]) -> tuple[float, Floats]:
    """The hypothesis that brings most together, of those without a turn for each pair, and with one
    for each two pairs."""
    a, b = theirs[pairs[:, 0]], own[pairs[:, 1]]
    turns, shifts = [np.zeros(1), np.zeros(len(a))], [np.zeros((1, 2)), b - a]
    first, second = np.triu_indices(len(pairs), 1)
    differ = (pairs[first, 0] != pairs[second, 0]) & (pairs[first, 1] != pairs[second, 1])
    first, second = first[differ], second[differ]
    across_a, across_b = a[second] - a[first], b[second] - b[first]
    turn = np.arctan2(across_b[:, 1], across_b[:, 0]) - np.arctan2(across_a[:, 1], across_a[:, 0])
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    stretch = np.abs(np.linalg.norm(across_a, axis=1) - np.linalg.norm(across_b, axis=1))
    fits = (np.abs(turn) <= MAX_TURN_RAD) & (stretch <= TOGETHER_M)
    fits &= np.linalg.norm(across_a, axis=1) > 1.0
    turn, first, second = turn[fits], first[fits], second[fits]
    middle_a, middle_b = (a[first] + a[second]) / 2, (b[first] + b[second]) / 2
    turns.append(turn)
    shifts.append(middle_b - _turned(middle_a, turn))
    all_turns, all_shifts = np.concatenate(turns), np.concatenate(shifts)
    near = np.linalg.norm(all_shifts, axis=1) <= MAX_SHIFT_M
    all_turns, all_shifts = all_turns[near], all_shifts[near]
    moved = _turned(theirs[None], all_turns[:, None]) + all_shifts[:, None]
    apart = np.linalg.norm(moved[:, :, None] - own[None, None], axis=3).min(axis=2)
    gain = np.exp(-0.5 * (apart / (2 * SPREAD_M)) ** 2).sum(axis=1)
    # Two landmarks brought together by a small correction are likelier than by a large one.
    gain -= 0.5 * (np.linalg.norm(all_shifts, axis=1) / PRIOR_SHIFT_M) ** 2 * 0.25
    gain -= 0.5 * (all_turns / PRIOR_TURN_RAD) ** 2 * 0.25
    best = int(gain.argmax())
    return float(all_turns[best]), all_shifts[best]


def _refine(own: Floats, theirs: Floats, turn: float, shift: Floats) -> tuple[float, Floats]:
    """Gauss-Newton on the nearest landmarks, with the prior as one more observation."""
    for _ in range(ROUNDS):
        turned = _turned(theirs, np.full(len(theirs), turn))
        moved = turned + shift
        apart = np.linalg.norm(moved[:, None] - own[None], axis=2)
        nearest = apart.argmin(axis=1)
        distance = apart[np.arange(len(moved)), nearest]
        weight = (distance < 2 * TOGETHER_M) / (1.0 + (distance / (2 * SPREAD_M)) ** 2) ** 2
        error = own[nearest] - moved
        slope = np.zeros((len(moved), 2, 3))
        slope[:, 0, 0] = slope[:, 1, 1] = 1.0
        slope[:, 0, 2], slope[:, 1, 2] = -turned[:, 1], turned[:, 0]
        scaled = slope * (weight / SPREAD_M**2)[:, None, None]
        normal = np.einsum("nij,nik->jk", scaled, slope)
        normal += np.diag([PRIOR_SHIFT_M**-2, PRIOR_SHIFT_M**-2, PRIOR_TURN_RAD**-2])
        push = np.einsum("nij,ni->j", scaled, error)
        push -= np.array([*(shift / PRIOR_SHIFT_M**2), turn / PRIOR_TURN_RAD**2])
        step = np.linalg.solve(normal, push)
        shift, turn = shift + step[:2], turn + float(step[2])
        if np.abs(step).max() < 1e-5:
            break
    return turn, shift


def _apply(points: Floats, turn: float, shift: Floats) -> Floats:
    return _turned(points, np.full(len(points), turn)) + shift


def _turned(points: Floats, turn: Floats) -> Floats:
    """Points (..., 2) turned by angles (...)."""
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _matrix(turn: float, shift: Floats) -> Matrix:
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    matrix[:2, 3] = shift
    return matrix
