"""What stands beside the road: buildings, walls, trees, poles, and clutter of a car's size."""

from __future__ import annotations

import numpy as np

from worlds.road.meshes import Floats, Mesh, boxes, cylinder, join, leaves
from worlds.road.streets import DEPTH_M, LENGTH_M, Block, Street

REACH_M = 190.0
"""Beyond this along the main road nothing stands: no sensor would see it."""
MAX_DEPTH_M = 70.0
"""Buildings further from the main road are left out."""


class _Yard:
    """Collects parts in the world frame. A row runs along one edge of a block: `s` along the edge,
    `away` from it into the block, `z` above the block's surface."""

    def __init__(self, street: Street, rng: np.random.Generator) -> None:
        self.street, self.rng = street, rng
        self.parts: list[Mesh] = []
        self._middles: list[Floats] = []
        self._sizes: list[tuple[float, float, float]] = []
        self._headings: list[float] = []

    def place(self, row: _Row, s: float, away: float, z: float) -> Floats:
        u, depth = row.spot(s, away)
        spot: Floats = self.street.land(row.block, u, depth) + np.array([0.0, 0.0, z])
        return spot

    def box(
        self,
        row: _Row,
        s: float,
        away: float,
        z: float,
        size: tuple[float, float, float],
        turn: float = 0.0,
    ) -> None:
        """A box with its middle there; `size` is along the edge, away from it, upwards."""
        self._middles.append(self.place(row, s, away, z))
        self._sizes.append(size)
        u, depth = row.spot(s, away)
        v = row.block.side * (self.street.half_width + depth)
        heading = self.street.heading(u, v, across=row.across)
        self._headings.append(heading + turn)

    def mesh(self) -> Mesh:
        return join([*self.parts, boxes(self._middles, self._sizes, self._headings)])


class _Row:
    """One edge of a block: along the main road, or along a side road."""

    def __init__(self, block: Block, edge: str) -> None:
        self.block, self.edge = block, edge
        self.across = edge != "main"
        low, high = max(block.start, -REACH_M), min(block.end, REACH_M)
        self.start, self.end = (
            (low + 1.0, high - 1.0) if edge == "main" else (block.setback_m, MAX_DEPTH_M)
        )

    def spot(self, s: float, away: float) -> tuple[float, float]:
        """(u, distance from the main road's kerb) of a place of this row."""
        if self.edge == "main":
            return s, away
        return (self.block.start + away if self.edge == "start" else self.block.end - away), s


def surroundings(street: Street, rng: np.random.Generator) -> Mesh:
    """Everything that stands still and is no vehicle, in the world frame."""
    yard = _Yard(street, rng)
    for block in street.blocks:
        if block.end < -REACH_M or block.start > REACH_M:
            continue
        rows = [_Row(block, "main")]
        rows += [_Row(block, "start")] if block.start > -LENGTH_M else []
        rows += [_Row(block, "end")] if block.end < LENGTH_M else []
        built = rng.random() < 0.85
        for row in rows:
            if row.end - row.start > 4.0:
                (_buildings if built else _green)(yard, row)
                _furniture(yard, row)
        if rng.random() < 0.45:
            _clutter(yard, rows[0])
    _ends(yard)
    return yard.mesh()


def _setback(row: _Row) -> float:
    return row.block.setback_m if row.edge == "main" else row.block.pavement_m + 0.5


def _buildings(yard: _Yard, row: _Row) -> None:
    """Houses in a row with gaps, walls or fences between them."""
    rng = yard.rng
    s = row.start + rng.uniform(0.0, 4.0)
    while s < row.end - 6.0:
        front = min(rng.uniform(7.0, 30.0), row.end - s)
        deep, tall = rng.uniform(8.0, 16.0), rng.uniform(3.5, 22.0)
        line = _setback(row) + float(rng.choice([0.0, 0.0, rng.uniform(0.0, 5.0)]))
        yard.box(row, s + front / 2, line + deep / 2, tall / 2 - 1.0, (front, deep, tall + 2.0))
        _relief(yard, row, s, front, line, tall)
        s += front
        gap = float(rng.choice([0.0, rng.uniform(1.0, 6.0), rng.uniform(5.0, 25.0)]))
        if gap > 2.0 and rng.random() < 0.6:
            tall = rng.uniform(0.8, 2.6)
            size = (gap, rng.uniform(0.1, 0.35), tall + 1.0)
            yard.box(row, s + gap / 2, line + 0.3, tall / 2 - 0.5, size)
        s += gap


def _relief(yard: _Yard, row: _Row, s: float, front: float, line: float, tall: float) -> None:
    """Pilasters, bays, ledges and steps in front of a wall."""
    rng = yard.rng
    kind = int(rng.integers(5))
    if kind == 0:
        for at in np.arange(s + 1.0, s + front - 0.5, rng.uniform(2.0, 5.0)):
            yard.box(row, float(at), line, tall / 2, (rng.uniform(0.3, 0.8), 0.6, tall))
    elif kind == 1:
        for z in np.arange(rng.uniform(2.5, 3.5), tall, 3.2):
            yard.box(row, s + front / 2, line - 0.2, float(z), (front, rng.uniform(0.6, 2.0), 0.3))
    elif kind == 2:
        for at in np.arange(s + 2.0, s + front - 2.0, rng.uniform(4.0, 7.0)):
            size = (rng.uniform(1.5, 3.0), 1.2, min(tall, rng.uniform(2.0, 8.0)))
            yard.box(row, float(at), line, size[2] / 2, size)
    if rng.random() < 0.5:
        wide = rng.uniform(1.5, 4.0)
        at = s + rng.uniform(0.2, 0.8) * front
        for step in range(3):
            yard.box(row, at, line, 0.1 + 0.15 * step, (wide, 1.8 - 0.6 * step, 0.2 + 0.3 * step))


def _green(yard: _Yard, row: _Row) -> None:
    """A park or open land: hedges, walls or guard rails, bushes and trees."""
    rng = yard.rng
    line = _setback(row)
    kind = int(rng.integers(4))
    tall = rng.uniform(0.5, 2.2)
    for s in np.arange(row.start, row.end - 4.0, 4.0):
        at = float(s) + 2.0
        if kind == 0 and rng.random() < 0.85:
            wide = rng.uniform(0.7, 1.2)
            yard.box(row, at, line, tall / 2, (4.0, wide, tall))
            radii = (1.8, 1.8, tall / 2 + 0.1)
            yard.parts.append(leaves(yard.place(row, at, line, tall / 2), radii, 12, 0.15, rng))
        elif kind == 1:
            yard.box(row, at, line, tall / 2, (4.1, 0.3, tall + 0.6))
        elif kind == 2:
            yard.box(row, at, line, 0.6, (4.1, 0.1, 0.32))
            yard.box(row, at, line, 0.3, (0.12, 0.12, 0.6))
    for _ in range(int((row.end - row.start) / 14.0)):
        s, away = rng.uniform(row.start, row.end), line + rng.uniform(2.0, 30.0)
        if rng.random() < 0.5:
            _tree(yard, row, float(s), float(away))
        else:
            size = rng.uniform(0.5, 1.6, 3)
            yard.parts.append(leaves(yard.place(row, s, away, size[2] * 0.7), size, 50, 0.2, rng))


def _tree(yard: _Yard, row: _Row, s: float, away: float) -> None:
    rng = yard.rng
    trunk, radius = rng.uniform(1.6, 4.0), rng.uniform(0.08, 0.3)
    foot = yard.place(row, s, away, -0.3)
    lean = np.append(rng.normal(0.0, 0.15, 2), trunk + 1.0)
    yard.parts.append(cylinder(foot, lean, radius, radius * 0.7))
    if rng.random() < 0.4:
        # Many of CARLA's crowns let rays pass.
        return
    crown = np.append(np.full(2, rng.uniform(1.0, 2.8)), rng.uniform(1.0, 2.5))
    top = foot + lean + [0.0, 0.0, crown[2] * 0.6]
    count = int(rng.integers(20, 90))
    yard.parts.append(leaves(top, crown, count, rng.uniform(0.1, 0.35), rng))


def _furniture(yard: _Yard, row: _Row) -> None:
    """Trees and poles along the kerb, and what else stands on a pavement."""
    rng = yard.rng
    line = min(rng.uniform(0.5, 1.2), row.block.pavement_m - 0.5)
    trees, poles = rng.random() < 0.4, rng.random() < 0.7
    spacing = rng.uniform(6.0, 16.0)
    for s in np.arange(row.start + rng.uniform(1.0, 8.0), row.end - 1.0, spacing):
        at = float(s + rng.normal(0.0, 0.5))
        if trees and rng.random() < 0.8:
            _tree(yard, row, at, line)
        if poles and rng.random() < 0.5:
            _pole(yard, row, at + spacing / 2, line)
        if rng.random() < 0.45:
            _thing(yard, row, at + rng.uniform(1.5, 4.0), line)


def _pole(yard: _Yard, row: _Row, s: float, away: float) -> None:
    rng = yard.rng
    tall = rng.uniform(2.2, 8.0)
    thick = rng.uniform(0.05, 0.13)
    foot = yard.place(row, s, away, -0.2)
    yard.parts.append(cylinder(foot, (0.0, 0.0, tall), thick, thick * 0.8))
    if rng.random() < 0.6:
        plate = (rng.uniform(0.3, 1.0), 0.06, rng.uniform(0.3, 0.9))
        yard.box(row, s, away, rng.uniform(1.6, 2.6), plate, rng.choice([0.0, np.pi / 2]))


_THINGS = {
    "bin": (0.5, 0.5, 1.0),
    "bench": (1.8, 0.6, 0.45),
    "post box": (0.5, 0.4, 1.3),
    "switch box": (1.2, 0.5, 1.4),
    "planter": (1.6, 0.9, 0.6),
    "hydrant": (0.3, 0.3, 0.8),
    "bicycles": (1.9, 0.25, 1.0),
    "barrier": (1.5, 0.4, 1.0),
    "bollard": (0.2, 0.2, 0.9),
}


def _thing(yard: _Yard, row: _Row, s: float, away: float) -> None:
    """A small thing, a shelter or a kiosk."""
    rng = yard.rng
    kind = rng.random()
    if kind < 0.85:
        size = list(_THINGS.values())[int(rng.integers(len(_THINGS)))]
        scaled = tuple(float(edge * rng.uniform(0.8, 1.25)) for edge in size)
        yard.box(row, s, away, scaled[2] / 2, (scaled[0], scaled[1], scaled[2]))
    elif row.block.pavement_m > 3.0:
        # A shelter: back, side and roof; or a closed kiosk.
        if rng.random() < 0.5:
            yard.box(row, s, away + 1.6, 1.2, (4.0, 0.08, 2.3))
            yard.box(row, s + 2.0, away + 0.9, 1.2, (0.08, 1.4, 2.3))
            yard.box(row, s, away + 0.9, 2.4, (4.2, 1.8, 0.12))
        else:
            yard.box(row, s, away + 0.9, 1.3, (rng.uniform(2.0, 4.0), 1.8, 2.6))


def _clutter(yard: _Yard, row: _Row) -> None:
    """What is as large as a vehicle and is none: containers, skips, stacks, cut hedges."""
    rng = yard.rng
    if row.block.parking or row.block.setback_m - row.block.pavement_m < 2.5:
        return
    away = row.block.pavement_m + 1.3
    for _ in range(int(rng.integers(1, 7))):
        s = rng.uniform(row.start + 4.0, max(row.start + 4.1, row.end - 4.0))
        turn = rng.normal(0.0, 0.15)
        size = (rng.uniform(2.0, 6.5), rng.uniform(1.0, 2.3), rng.uniform(0.8, 2.6))
        if rng.random() < 0.5:
            yard.box(row, s, away, size[2] / 2, size, turn)
        else:
            for _ in range(int(rng.integers(2, 6))):
                part = (size[0] * rng.uniform(0.3, 0.8), size[1] * rng.uniform(0.4, 0.9), size[2])
                at = s + rng.uniform(-0.3, 0.3) * size[0]
                part = (part[0], part[1], float(part[2] * rng.uniform(0.4, 1.0)))
                yard.box(row, at, away, part[2] / 2, part, turn)


def _ends(yard: _Yard) -> None:
    """Something stands where the roads leave the scene, as towns close the view."""
    street, rng = yard.street, yard.rng
    depth = min(DEPTH_M - 5.0, 90.0)
    for crossing in street.crossings:
        for side in crossing.sides:
            if rng.random() < 0.7:
                middle = street.place(crossing.u, side * depth)
                heading = street.heading(crossing.u, side * depth)
                yard.parts.append(boxes(middle, (40.0, 6.0, rng.uniform(4.0, 20.0)), heading))
    for side in (-1, 1):
        if rng.random() < 0.5:
            middle = street.place(side * (LENGTH_M - 10.0), 0.0)
            yard.parts.append(boxes(middle, (6.0, 60.0, 20.0), street.heading(side * 200.0, 0.0)))
