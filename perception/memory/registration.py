"""How objects have moved since others showed them, by the ego's own points of them.

What the ego sees of an object alone is a part of it, and the middle of that part's box lies beside
the object's. Its points do better: laid over those that it had when the object was last shown
whole, they tell how far it has moved since (Held, Levinson, Thrun and Savarese, "Combining 3D
shape, color, and motion for robust anytime tracking", 2014, search displacements so). Here the
displacement is sought that brings either cloud's points nearest to the other's, seen from above.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.geometry import Matrix, Points, invert

Floats = NDArray[np.float64]
Places = NDArray[np.float64]

FRESH_S = 0.6
"""What an object showed longer ago looks other by now."""
LEAST, MOST = 6, 48
"""Cells that tell where an object is, and of those that are compared, the most."""
CELL_M = 0.1
"""Points are thinned to cells of this."""
MARGIN_M = 0.25
"""What a box's points may lie outside of it."""
GROUND, ABOVE_M = 0.13, 0.3
"""Share of the height from below that is the ground's, and what may stand out on top."""
APART_M = 0.3
"""Points farther from all others have no partner: how far does not matter."""
UNLIKELY = 0.8
"""What a variance that the displacement is off from what was expected costs, beside a cell that has
no partner."""
LEAST_REACH_M, MOST_REACH_M, MOST_ASIDE_M = 0.2, 1.5, 0.3
"""Displacements that are tried, from what is expected: along the object's heading, and across."""
SD_M, USUAL_CELLS = 0.1, 40
"""Standard deviation of the displacement along an axis, of an object with so many cells; fewer tell
less. Measured on floors and streets of seeds from 1,940,000 on."""
TILE_M, TILES = 4.0, 128
"""Points are found by square tiles, so many along x and y around the sensor."""
TABLE_M = 0.05
"""Cells of the table of distances."""


@dataclass(frozen=True, slots=True)
class _Table:
    """How far places are from the nearest of some cells, at most APART_M, in its square metres."""

    origin: Floats
    squared: Floats

    def of(self, places: Places) -> Floats:
        """(..., 2) metres to (...)."""
        at = np.rint((places - self.origin) / TABLE_M).astype(np.intp)
        inside = ((at >= 0) & (at < self.squared.shape)).all(axis=-1)
        at[~inside] = 0
        return np.where(inside, self.squared[at[..., 0], at[..., 1]], APART_M**2)


class Cloud:
    """What the ego sees in a frame. Not to be changed."""

    def __init__(self, points: Points, world_from_sensor: Matrix) -> None:
        """`points`: float32 (N, 3) in the sensor's frame."""
        self._points = points
        self._sensor_from_world = invert(world_from_sensor)

    def __deepcopy__(self, memo: dict[int, object]) -> Cloud:
        return self

    def within(self, box: Boxes, along: float, across: float) -> Places:
        """(K, 2): points in a box (1,) of the world frame that is so much longer and wider, from
        its middle along its axes."""
        box = box.transformed(self._sensor_from_world)
        (length, width, height), center = box.sizes[0], box.centers[0]
        near = self._near(center, np.hypot(length, width) / 2.0 + along) - center
        low, high = (GROUND - 0.5) * height, 0.5 * height + ABOVE_M
        places = near[(near[:, 2] > low) & (near[:, 2] < high), :2] @ _turn(box.headings[0])
        half = np.array([length / 2.0 + along, width / 2.0 + across])
        inside: Places = places[(np.abs(places) < half).all(axis=1)]
        return inside

    def _near(self, center: Floats, reach: float) -> Floats:
        """(M, 3): points of the tiles that are so near along x and y, all of them among these."""
        points, tiles = self._tiled
        first = _tile(center[:2] - reach)
        last = _tile(center[:2] + reach)
        rows = range(int(first[0]), int(last[0]) + 1)
        ends = [(row * TILES + first[1], row * TILES + last[1] + 1) for row in rows]
        parts = [slice(*np.searchsorted(tiles, end)) for end in ends]
        return np.concatenate([points[part] for part in parts]).astype(np.float64)

    @cached_property
    def _tiled(self) -> tuple[Points, NDArray[np.int16]]:
        """The points by tile, and whose each is."""
        at = _tile(self._points[:, :2])
        number = (at[:, 0] * TILES + at[:, 1]).astype(np.int16)
        order = np.argsort(number, kind="stable")
        return self._points[order], number[order]


@dataclass(frozen=True)
class Look:
    """At an object, when others showed it whole. Not to be changed."""

    time_s: float
    cloud: Cloud
    box: Boxes
    """(1,) of the object, in the world frame."""

    def __deepcopy__(self, memo: dict[int, object]) -> Look:
        return self

    @cached_property
    def cells(self) -> Places:
        """(K, 2): of the object's points, from its middle along its axes."""
        return _thinned(self.cloud.within(self.box, MARGIN_M, MARGIN_M), MOST)

    @cached_property
    def table(self) -> _Table:
        """How far places are from the nearest of these cells."""
        return _table(self.cells)


def displaced(look: Look, cloud: Cloud, box: Boxes, sd_m: float) -> tuple[Floats, float] | None:
    """Where an object is now.

    `cloud`: of now; `box` (1,): the object's in the world frame, where it is expected, with that
    standard deviation along an axis. Returns its middle (2,) in the world
    frame, and the standard deviation of that; None where too little is seen of it.
    """
    reach = float(np.clip(3.0 * sd_m, LEAST_REACH_M, MOST_REACH_M))
    aside = float(np.clip(2.0 * sd_m, CELL_M, MOST_ASIDE_M))
    then = look.cells
    if len(then) < LEAST:
        return None
    now = _thinned(cloud.within(box, MARGIN_M + reach, MARGIN_M + aside), 2 * MOST)
    if len(now) < LEAST:
        return None
    table = _table(now)
    half = box.sizes[0, :2] / 2.0 + MARGIN_M

    def best(tried: Places) -> tuple[Floats, float]:
        left = table.of(then + tried[:, None]).mean(axis=1)
        back = now - tried[:, None]
        inside = (np.abs(back) < half).all(axis=2)
        right = (look.table.of(back) * inside).sum(axis=1)
        right /= np.maximum(inside.sum(axis=1), len(then) / 3.0)
        cost = (left + right) / APART_M**2
        at = int((cost + UNLIKELY / len(then) * (tried**2).sum(axis=1) / sd_m**2).argmin())
        return tried[at], float(cost[at])

    found, _ = best(_grid(reach, 0.0, 0.1))
    found, _ = best(found + _grid(0.1, aside, 0.05))
    found, cost = best(found + _grid(0.05, 0.05, 0.025))
    if cost > 1.0:
        return None
    middle = box.centers[0, :2] + _turn(box.headings[0]) @ found
    return middle, SD_M * float(np.sqrt(max(1.0, USUAL_CELLS / len(then))))


def _tile(places: NDArray[np.floating[Any]]) -> NDArray[np.intp]:
    """(..., 2) metres to the number of the tile along x and y; all beyond the last are in it."""
    tile = np.floor(places / TILE_M) + TILES // 2
    inside: NDArray[np.intp] = np.clip(tile, 0, TILES - 1).astype(np.intp)
    return inside


def _thinned(places: Places, most: int) -> Places:
    """The middle of those in each cell, of at most so many cells, evenly taken."""
    if not len(places):
        return places
    cells, which, count = np.unique(
        np.floor(places / CELL_M), axis=0, return_inverse=True, return_counts=True
    )
    middles = np.zeros((len(cells), 2))
    np.add.at(middles, which.ravel(), places)
    middles /= count[:, None]
    if len(middles) > most:
        middles = middles[np.linspace(0, len(middles) - 1, most).astype(np.intp)]
    return middles


def _table(cells: Places) -> _Table:
    from scipy.ndimage import distance_transform_edt

    origin = cells.min(axis=0) - APART_M
    at = np.rint((cells - origin) / TABLE_M).astype(np.intp)
    free = np.ones(at.max(axis=0) + 1 + round(APART_M / TABLE_M), dtype=np.bool_)
    free[at[:, 0], at[:, 1]] = False
    apart = distance_transform_edt(free) * TABLE_M
    return _Table(origin, np.minimum(apart, APART_M) ** 2)


def _grid(along: float, across: float, step: float) -> Places:
    """(M, 2): displacements around none, so far both ways."""
    x, y = (np.arange(-round(far / step), round(far / step) + 1) * step for far in (along, across))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _turn(heading: float) -> Floats:
    """(2, 2): from an object's axes to the world's."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin], [sin, cos]])
