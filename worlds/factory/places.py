"""Names of the factory's parts: aisles, crossings, racks, machines, the docks of the conveyor."""

from __future__ import annotations

from worlds.factory.layout import AISLE_M, BLOCK_M, PITCH_M, Block, Floor

Polygon = tuple[tuple[float, float], ...]
BAY_M = 5.4
"""Depth of the forklift bay on the south side of a conveyor."""
_EQUIPMENT = {"shelving": "racks", "machines": "machines", "conveyor": "conveyors"}


def named_places(floor: Floor) -> tuple[tuple[str, Polygon], ...]:
    """Names and corners (x, y in the world frame, metres), several with one name being one place.

    Aisles run from south to north, `aisle 1` in the west; cross aisles from west to east,
    `cross aisle 1` in the south. `crossing` is where inner ones of both meet. The docks are the
    forklift bays of the conveyors with the aisle before them.
    """
    columns = round((floor.width_m - AISLE_M) / PITCH_M)
    rows = round((floor.depth_m - AISLE_M) / PITCH_M)
    aisles = [
        (f"aisle {i + 1}", _rectangle(i * PITCH_M, 0.0, i * PITCH_M + AISLE_M, floor.depth_m))
        for i in range(columns + 1)
    ]
    across = [
        (f"cross aisle {j + 1}", _rectangle(0.0, j * PITCH_M, floor.width_m, j * PITCH_M + AISLE_M))
        for j in range(rows + 1)
    ]
    crossings = [
        (
            "crossing",
            _rectangle(i * PITCH_M, j * PITCH_M, i * PITCH_M + AISLE_M, j * PITCH_M + AISLE_M),
        )
        for i in range(1, columns)
        for j in range(1, rows)
    ]
    blocks = [(_EQUIPMENT[block.kind], _block(block)) for block in floor.blocks]
    docks = [("docks", _dock(block)) for block in floor.blocks if block.kind == "conveyor"]
    return (*aisles, *across, *crossings, *docks, *blocks)


def _block(block: Block) -> Polygon:
    half = BLOCK_M / 2
    return _rectangle(block.x - half, block.y - half, block.x + half, block.y + half)


def _dock(block: Block) -> Polygon:
    half = BLOCK_M / 2
    south = block.y - half
    return _rectangle(block.x - half, south - AISLE_M, block.x + half, south + BAY_M)


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return tuple((round(x, 3), round(y, 3)) for x, y in corners)
