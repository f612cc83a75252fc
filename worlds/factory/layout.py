"""The part of the factory that stands still: square blocks of equipment between wide aisles.

The floor is a grid of blocks with aisles between and around them; the origin is its south-west
corner. Lanes are rings around a block at a fixed distance from its edge, so that lanes of
different distance never cross, and the lanes of neighbours share an aisle side by side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Kind = Literal["shelving", "machines", "conveyor"]

BLOCK_M = 12.4
AISLE_M = 8.4
"""Two blocks and three aisles are 50 m: the floor of up to six robots."""
PITCH_M = BLOCK_M + AISLE_M
MIN_BLOCKS = 4
BLOCKS_PER_ROBOT = 4 / 6
WALL_HEIGHT_M = 6.0
PILLAR_M = 0.5
RACK_HEIGHT_M = 4.0
KINDS: tuple[Kind, ...] = ("shelving", "machines", "conveyor", "shelving")


@dataclass(frozen=True, slots=True)
class Block:
    """A square of equipment, `BLOCK_M` wide, around (x, y)."""

    x: float
    y: float
    kind: Kind


@dataclass(frozen=True, slots=True)
class Floor:
    """Everything that does not move."""

    width_m: float
    depth_m: float
    blocks: tuple[Block, ...]
    boxes: Floats
    """(N, 6): low and high corner (x, y, z, x, y, z) of axis-aligned boxes, metres."""


def build_floor(robots: int, rng: np.random.Generator, room: float = 1.0) -> Floor:
    """A floor that is large enough for that many robots, filled at random; `room` times as large
    as usual."""
    wanted = math.ceil(room * max(MIN_BLOCKS, math.ceil(robots * BLOCKS_PER_ROBOT)))
    columns = math.ceil(math.sqrt(wanted))
    rows = math.ceil(wanted / columns)
    blocks = tuple(
        Block(
            AISLE_M + BLOCK_M / 2 + column * PITCH_M,
            AISLE_M + BLOCK_M / 2 + row * PITCH_M,
            KINDS[(row * columns + column) % len(KINDS)],
        )
        for row in range(rows)
        for column in range(columns)
    )
    width, depth = columns * PITCH_M + AISLE_M, rows * PITCH_M + AISLE_M
    parts = [_walls(width, depth), _pillars(columns, rows)]
    fillers = {"shelving": _shelving, "machines": _machines, "conveyor": _conveyor}
    for block in blocks:
        local = fillers[block.kind](rng)
        parts.append(local + np.array([block.x, block.y, 0.0] * 2))
    return Floor(width, depth, blocks, np.concatenate(parts))


def triangles(boxes: Floats) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """The boxes' surfaces: vertices float32 (8 N, 3) and triangles uint32 (12 N, 3)."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
    vertices = boxes[:, None, :3] + corners * (boxes[:, None, 3:] - boxes[:, None, :3])
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    indices = faces[None] + 8 * np.arange(len(boxes))[:, None, None]
    return vertices.reshape(-1, 3).astype(np.float32), indices.reshape(-1, 3).astype(np.uint32)


def _box(x: float, y: float, z: float, length: float, width: float, height: float) -> list[float]:
    """A box that stands on height z with its middle over (x, y)."""
    return [
        x - length / 2, y - width / 2, z, x + length / 2, y + width / 2, z + height,
    ]  # fmt: skip


def _walls(width: float, depth: float) -> Floats:
    thick, high = 0.3, WALL_HEIGHT_M
    return np.array(
        [
            [-thick, -thick, 0, 0, depth + thick, high],
            [width, -thick, 0, width + thick, depth + thick, high],
            [0, -thick, 0, width, 0, high],
            [0, depth, 0, width, depth + thick, high],
        ],
        dtype=np.float64,
    )


def _pillars(columns: int, rows: int) -> Floats:
    """One in the middle of every crossing of two aisles, where no lane passes."""
    return np.array(
        [
            _box(
                AISLE_M / 2 + i * PITCH_M, AISLE_M / 2 + j * PITCH_M, 0,
                PILLAR_M, PILLAR_M, WALL_HEIGHT_M,
            )
            for i in range(columns + 1)
            for j in range(rows + 1)
        ]
    )  # fmt: skip


def _shelving(rng: np.random.Generator) -> Floats:
    """Four pallet racks along x or y: uprights, decks and goods of random size."""
    length, depth, bays = 12.0, 1.1, 5
    bay = length / bays
    boxes = []
    for y in (-5.0, -1.8, 1.8, 5.0):
        for i in range(bays + 1):
            for side in (-0.5, 0.5):
                boxes.append(
                    _box(-length / 2 + i * bay, y + side, 0, 0.1, 0.1, RACK_HEIGHT_M)
                )  # fmt: skip
        for z in (0.1, 1.4, 2.7):
            boxes.append(_box(0, y, z, length, depth, 0.1))
            for i in range(bays):
                wide, deep, high = rng.uniform([1.2, 0.8, 0.5], [2.2, 1.0, 1.1])
                if rng.random() < 0.75:
                    middle = -length / 2 + (i + 0.5) * bay
                    boxes.append(_box(middle, y, z + 0.1, wide, deep, high))
    racks = np.array(boxes)
    return racks[:, [1, 0, 2, 4, 3, 5]] if rng.random() < 0.5 else racks


def _machines(rng: np.random.Generator) -> Floats:
    """A three by three pattern of machines, each with a cabinet on top or beside."""
    boxes = []
    for x in (-4.2, 0.0, 4.2):
        for y in (-4.2, 0.0, 4.2):
            long, wide, high = rng.uniform([1.6, 1.4, 1.2], [3.4, 2.8, 2.2])
            boxes.append(_box(x, y, 0, long, wide, high))
            boxes.append(_box(x + rng.uniform(-0.4, 0.4), y, high, 0.8, 0.8, 0.6))
    return np.array(boxes)


def _conveyor(rng: np.random.Generator) -> Floats:
    """Two belts on legs with parcels, fed by a machine; the south side is a forklift bay."""
    boxes = [_box(-4.6, 2.0, 0, 2.4, 5.0, 2.2)]
    for y in (0.0, 4.0):
        boxes.append(_box(1.2, y, 0.75, 9.2, 0.8, 0.12))
        for x in np.linspace(-3.2, 5.6, 6):
            boxes.append(_box(float(x), y, 0, 0.1, 0.7, 0.75))
        for x in np.arange(-2.8, 5.6, 1.3):
            size = rng.uniform(0.3, 0.6, 3)
            boxes.append(_box(float(x + rng.uniform(-0.3, 0.3)), y, 0.87, *size))
    return np.array(boxes)
