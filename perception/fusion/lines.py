"""Laying a sender's outline over lines: from a rough correction to one of a centimetre.

A likelihood field has cells, and a wall within one of them may be anywhere in it. So each place of
the outline is laid over the line through the nearest places that the ego sees (point to line
iterative closest points: Censi, "An ICP variant using a point-to-line metric", 2008), weighed by
how well it fits (Geman and McClure, "Statistical methods for tomographic image reconstruction",
1987), with how far poses usually err as the prior.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from perception.fusion.alignment import INDEPENDENT, PRIOR, STRAY, Estimate

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

CELL_M = 0.15
"""What the ego sees is thinned to one place of each cell, the mean."""
WIDE = 10_000
"""More cells than there are in a row."""
LINE = 6
"""Places that make a line."""
THIN = 0.1
"""Across a line, places vary at most so much as along it."""
NEAR_M = 0.35
"""A place farther from all that the ego sees shows something else."""
FITS_M = 0.05
"""Distance from its line at which a place counts for a quarter."""
STEPS = 4
SETTLED = (0.002, 0.002, 0.0002)
"""A step along x and y, metres, and turn, radians, after which no other is taken: far less than
what outlines tell."""
MIN_PLACES = 6
"""Fewer that lie on lines tell nothing."""


class Lines:
    """Everything that stands around the ego, as lines."""

    def __init__(self, places: NDArray[np.floating]) -> None:
        """`places` (N, 2), metres."""
        self._places = _thinned(places)
        self._tree: cKDTree | None = None

    def __len__(self) -> int:
        return len(self._places)

    def and_of(self, places: Floats) -> Lines:
        """These and those of more places."""
        return Lines(np.concatenate([self._places, places]))

    def prepare(self) -> None:
        """Does what needs no sender."""
        from scipy.spatial import cKDTree

        if self._tree is None:
            self._tree = cKDTree(self._places)

    def refine(self, rough: Estimate, places: Floats, sender: Floats) -> Estimate:
        """A better estimate of what a sender is off by that believes to stand at `sender` (2,) and
        to see `places` (N, 2), metres; the rough one where too few of them lie on lines."""
        self.prepare()
        if len(self._places) < LINE or not len(places):
            return rough
        around, move = places - sender, rough.move
        inverse = np.linalg.inv(PRIOR)
        for _ in range(STEPS):
            turned, off, normals, fits = self._fit(around, sender, move)
            if np.count_nonzero(fits) < MIN_PLACES:
                return rough
            lever = normals[:, 1] * turned[:, 0] - normals[:, 0] * turned[:, 1]
            slopes = np.column_stack([normals, lever])
            weights = fits * fits * (INDEPENDENT / FITS_M**2)
            information = slopes.T @ (slopes * weights[:, None]) + inverse
            pull = slopes.T @ (weights * off) + inverse @ move
            step = np.linalg.solve(information, pull)
            move = move - step
            if (np.abs(step) <= SETTLED).all():
                break  # How well places fit before so small a step is how well they fit after it.
        else:
            fits = self._fit(around, sender, move)[3]
        better = fits - self._fit(around, sender, np.zeros(3))[3]
        gain = INDEPENDENT * np.log(1.0 / STRAY) * better.sum() - 0.5 * move @ inverse @ move
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        return Estimate(move, covariance, float(gain))

    def _fit(self, around: Floats, sender: Floats, move: Floats) -> tuple[Floats, ...]:
        """Places (N, 2) around a sender under a move (3,): turned, and as `_from_lines` has them
        how far each is off its line, the normals, and how well each fits, 0 to 1."""
        cos, sin = np.cos(move[2]), np.sin(move[2])
        turned = around @ np.array([[cos, sin], [-sin, cos]])
        off, normals, there = self._from_lines(turned + sender + move[:2])
        return turned, off, normals, there / (1.0 + (off / FITS_M) ** 2)

    def _from_lines(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """Of places (N, 2): how far each is off the line near it (N,), metres, the line's normal
        (N, 2), and whether there is one (N,), 0 or 1."""
        assert self._tree is not None
        away, rows = self._tree.query(places, k=LINE)
        # One row for each of the LINE places: sums over rows are those that NumPy does fast.
        x, y = self._places.T[:, rows.T]
        middle = x.sum(axis=0) / LINE, y.sum(axis=0) / LINE
        x, y = x - middle[0], y - middle[1]
        xx, yy, xy = (x * x).sum(axis=0), (y * y).sum(axis=0), (x * y).sum(axis=0)
        half, mean = 0.5 * (xx - yy), 0.5 * (xx + yy)
        along, spread = 0.5 * np.arctan2(xy, half), np.hypot(half, xy)
        normals = np.column_stack([-np.sin(along), np.cos(along)])
        thin = mean - spread <= THIN * (mean + spread)
        fits = (thin & (away[:, 0] <= NEAR_M)).astype(np.float64)
        off = (places[:, 0] - middle[0]) * normals[:, 0] + (places[:, 1] - middle[1]) * normals[
            :, 1
        ]
        return off, normals, fits


def _thinned(places: NDArray[np.floating]) -> Floats:
    """The mean (K, 2) of the places in each cell."""
    if not len(places):
        return np.zeros((0, 2))
    column, row = np.floor(places / CELL_M).astype(np.int32).T
    cells = row * WIDE + column
    order = np.argsort(cells)
    ranked = cells[order]
    starts = np.flatnonzero(np.concatenate([[True], ranked[1:] != ranked[:-1]]))
    count = np.diff(starts, append=len(places))
    sums: Floats = np.add.reduceat(places[order].astype(np.float64), starts, axis=0)
    return sums / count[:, None]
