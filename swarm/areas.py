"""The floor as square cells, by which robots' beacons and scenes are told apart on a large site.

A robot says in its key in which cell it is; who wants to hear of a part of the floor listens to the
cells that it touches. Nobody agrees on anything: the cells of the world frame are the same for all.
"""

from __future__ import annotations

import math

CELL_M = 32.0
"""Side of a cell. Smaller ones follow a range more closely, larger ones are fewer: a range of 45 m
touches about 15, and what is heard beyond it is about as much as within."""
MAX_INDEX = 99_999
"""Cells further out count as the outermost: a pose may be any finite number."""

Cell = tuple[int, int]


def name_of(cell: Cell) -> str:
    """A cell as it stands in a key.

    >>> name_of((3, -4))
    '3_-4'
    """
    return f"{cell[0]}_{cell[1]}"


def cell_of(x: float, y: float) -> Cell:
    """The cell of a place in the world frame, metres.

    >>> cell_of(100.0, -100.0)
    (3, -4)
    """
    return _index(x), _index(y)


def cells_of_square(x: float, y: float, half_m: float) -> frozenset[Cell]:
    """All cells that a square around a place touches."""
    return frozenset(
        (column, row)
        for column in range(_index(x - half_m), _index(x + half_m) + 1)
        for row in range(_index(y - half_m), _index(y + half_m) + 1)
    )


def cells_of_disc(x: float, y: float, radius_m: float) -> frozenset[Cell]:
    """All cells that a disc around a place touches."""
    touched = (
        cell
        for cell in cells_of_square(x, y, radius_m)
        if math.hypot(_gap(cell[0], x), _gap(cell[1], y)) <= radius_m
    )
    # A place a rounding error off its cell's border is in it all the same.
    return frozenset({cell_of(x, y), *touched})


def _index(along: float) -> int:
    return math.floor(max(-MAX_INDEX, min(MAX_INDEX, along / CELL_M)))


def _gap(index: int, along: float) -> float:
    """From a coordinate to the cells of that index."""
    return max(0.0, index * CELL_M - along, along - (index + 1) * CELL_M)
