"""The plan of a street scene: a main road, crossings and the blocks between them.

A scene is planned in street coordinates (u along the main road, v to its left, metres), in which
roads and blocks are rectangles. `Street.place` bends, shears, turns and lifts them into the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worlds.road.meshes import Floats, Mesh, join, sheet

LENGTH_M, DEPTH_M = 230.0, 130.0
"""Half sizes of the ground: a robot near the middle sees 120 m."""
CELL_M = 8.0
"""Edge of the ground's cells; the ground bends by a centimetre within one."""
HILL_M = 3.0
"""How far the land may rise above the pavement."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane of the main road (across = v) or of a crossing (across = u)."""

    across: float
    direction: int
    """+1 or -1 along the road."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A side road."""

    u: float
    half_width: float
    lanes: tuple[Lane, ...]
    sides: tuple[int, ...]
    """(-1, 1): it crosses the main road; one of them: it ends there."""


@dataclass(frozen=True, slots=True)
class Block:
    """Raised ground beside the main road, between two side roads."""

    start: float
    end: float
    side: int
    pavement_m: float
    setback_m: float
    """From the kerb to the buildings."""
    parking: bool
    """Whether cars park between pavement and buildings."""
    climb: float
    """Slope of the land behind the pavement."""


@dataclass(frozen=True, slots=True)
class _Bends:
    """The main road's centre line, every metre, and the shape of the ground."""

    u: Floats
    x: Floats
    y: Floats
    heading: Floats
    shear: float
    waves: Floats
    """(K, 4): wave numbers along x and y, phase, height."""


@dataclass(frozen=True, slots=True)
class Street:
    """One scene's plan."""

    half_width: float
    lanes: tuple[Lane, ...]
    parking: tuple[int, ...]
    """Sides with a row of parked cars along the kerb."""
    median_m: float
    crossings: tuple[Crossing, ...]
    blocks: tuple[Block, ...]
    kerb_m: float
    bends: _Bends

    def place(self, u: ArrayLike, v: ArrayLike, lift: ArrayLike = 0.0) -> Floats:
        """World points (..., 3) on the road's surface, or `lift` above it."""
        u, v, lift = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (u, v, lift)))
        bends = self.bends
        along = u + bends.shear * v
        heading = np.interp(along, bends.u, bends.heading)
        x = np.interp(along, bends.u, bends.x) - v * np.sin(heading)
        y = np.interp(along, bends.u, bends.y) + v * np.cos(heading)
        return np.stack([x, y, self.height(x, y) + lift], axis=-1)

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height of the road's surface at world positions."""
        z = np.zeros_like(x)
        for kx, ky, phase, rise in self.bends.waves:
            z = z + rise * (np.sin(kx * x + ky * y + phase) - np.sin(phase))
        return z

    def heading(self, u: float, v: float, across: bool = False) -> float:
        """Direction in the world of growing u, or of growing v."""
        step = (0.0, 0.5) if across else (0.5, 0.0)
        ends = self.place([u - step[0], u + step[0]], [v - step[1], v + step[1]])
        dx, dy, _ = ends[1] - ends[0]
        return float(np.arctan2(dy, dx))

    def land(self, block: Block, u: ArrayLike, away: ArrayLike) -> Floats:
        """World points of a block's surface, `away` metres from the kerb."""
        away = np.asarray(away, dtype=np.float64)
        lift = self.kerb_m + np.clip(block.climb * (away - block.pavement_m), 0.0, HILL_M)
        return self.place(u, block.side * (self.half_width + away), lift)

    def ground(self) -> Mesh:
        """The road's surface, the blocks with their kerbs, and the raised median."""
        parts = [self._patch(_steps(-LENGTH_M, LENGTH_M), _steps(-DEPTH_M, DEPTH_M))]
        for block in self.blocks:
            u = _steps(block.start, block.end)
            away = np.concatenate([[0.0], _steps(block.pavement_m, DEPTH_M - self.half_width)])
            top = self.land(block, u[:, None], away[None])
            parts.append(sheet(top))
            for edge in (top[:, 0], top[0], top[-1]):
                parts.append(_skirt(edge))
        if self.median_m > 1.0:
            half = self.median_m / 2 - 0.3
            for start, end in self.gaps():
                u = _steps(start + 2.0, end - 2.0)
                strip = self.place(u[:, None], np.array([[-half, half]]), self.kerb_m)
                parts += [sheet(strip), _skirt(strip[:, 0]), _skirt(strip[:, 1])]
        return join(parts)

    def gaps(self, side: int = 0) -> list[tuple[float, float]]:
        """Stretches of u without a side road (on one side, or on any)."""
        cuts = [c for c in self.crossings if side == 0 or side in c.sides]
        starts = [-LENGTH_M, *(c.u + c.half_width for c in cuts)]
        ends = [*(c.u - c.half_width for c in cuts), LENGTH_M]
        return [(a, b) for a, b in zip(starts, ends, strict=True) if b - a > 8.0]

    def _patch(self, u: Floats, v: Floats) -> Mesh:
        return sheet(self.place(u[:, None], v[None]))


def _steps(start: float, end: float) -> Floats:
    return np.linspace(start, end, max(2, int(np.ceil((end - start) / CELL_M)) + 1))


def _skirt(edge: Floats) -> Mesh:
    """The upright face from an edge (N, 3) down into the ground."""
    return sheet(np.stack([edge, edge - [0.0, 0.0, 1.0]], axis=0))


def plan_street(rng: np.random.Generator) -> Street:
    """Another street every time."""
    lane_m = rng.uniform(3.2, 3.8)
    per_side = int(rng.choice([1, 2, 3], p=[0.35, 0.45, 0.2]))
    median = float(
        rng.choice([0.0, rng.uniform(0.4, 1.0), rng.uniform(2.0, 5.0)], p=[0.6, 0.2, 0.2])
    )
    parking = tuple(side for side in (-1, 1) if rng.random() < 0.5)
    half = median / 2 + per_side * lane_m + (2.5 if parking else rng.uniform(0.3, 1.5))
    # Right-hand traffic, as in CARLA: v > 0 is driven against u.
    lanes = tuple(
        Lane(-way * (median / 2 + (i + 0.5) * lane_m), way)
        for way in (1, -1)
        for i in range(per_side)
    )
    crossings = _plan_crossings(rng, lane_m)
    street = Street(
        half, lanes, parking, median, crossings, (), float(rng.uniform(0.1, 0.2)), _bend(rng)
    )
    blocks = tuple(
        _plan_block(start, end, side, rng) for side in (-1, 1) for start, end in street.gaps(side)
    )
    return Street(half, lanes, parking, median, crossings, blocks, street.kerb_m, street.bends)


def _plan_crossings(rng: np.random.Generator, lane_m: float) -> tuple[Crossing, ...]:
    # A crossing near the middle, most of the time, and others up and down the road.
    middle = rng.uniform(-45.0, 45.0) if rng.random() < 0.65 else rng.uniform(60.0, 150.0)
    places = [middle]
    for way in (1.0, -1.0):
        u = middle + way * rng.uniform(45.0, 220.0)
        while abs(u) < LENGTH_M - 20.0:
            places.append(u)
            u += way * rng.uniform(45.0, 220.0)
    found = []
    for u in sorted(places):
        per_side = int(rng.choice([1, 2], p=[0.6, 0.4]))
        half = per_side * lane_m + rng.uniform(0.3, 2.5)
        # Growing v is driven on the side of growing u.
        lanes = tuple(
            Lane(u + sign * (i + 0.5) * lane_m, sign) for sign in (1, -1) for i in range(per_side)
        )
        sides = ((-1, 1), (-1,), (1,))[int(rng.choice(3, p=[0.6, 0.2, 0.2]))]
        found.append(Crossing(u, half, lanes, sides))
    return tuple(found)


def _plan_block(start: float, end: float, side: int, rng: np.random.Generator) -> Block:
    parking = bool(rng.random() < 0.2)
    pavement = rng.uniform(1.8, 5.0)
    setback = pavement + (rng.uniform(9.0, 16.0) if parking else rng.choice([0.3, 3.0, 10.0]))
    climb = 0.0 if parking or rng.random() < 0.75 else rng.uniform(0.02, 0.2)
    return Block(start, end, side, pavement, float(setback), parking, float(climb))


def _bend(rng: np.random.Generator) -> _Bends:
    u = np.arange(-400.0, 401.0)
    sharpest = 0.0 if rng.random() < 0.45 else rng.uniform(0.0, 1.0 / 180.0)
    wave = 2 * np.pi / float(rng.choice([5000.0, 600.0]))
    curvature = sharpest * np.cos(wave * u + rng.uniform(0.0, 2 * np.pi))
    heading = rng.uniform(0.0, 2 * np.pi) + np.cumsum(curvature)
    x, y = np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading))
    middle = len(u) // 2
    origin = rng.uniform(-200.0, 200.0, 2)
    waves: NDArray[np.float64] = np.zeros((0, 4))
    if rng.random() < 0.5:
        count = 3
        length, way = rng.uniform(120.0, 400.0, count), rng.uniform(0.0, 2 * np.pi, count)
        steepest = rng.uniform(0.002, 0.013, count)
        number = 2 * np.pi / length
        waves = np.column_stack(
            [
                number * np.cos(way),
                number * np.sin(way),
                rng.uniform(0.0, 2 * np.pi, count),
                steepest / number,
            ]
        )
    shear = 0.0 if rng.random() < 0.6 else float(rng.uniform(-0.5, 0.5))
    return _Bends(
        u,
        x - x[middle] + origin[0],
        y - y[middle] + origin[1],
        heading,
        shear,
        waves,
    )
