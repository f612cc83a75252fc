"""The bird's-eye-view grids of the learned detectors, and the classes that each one finds."""

from __future__ import annotations

from dataclasses import dataclass

from swarm.errors import PerceptionError

STRIDE = 2
"""Pillars along one side of a cell of the feature map."""
PILLARS_OF_CELL = STRIDE * STRIDE


@dataclass(frozen=True, slots=True)
class BevConfig:
    """One detector: its area around the reference frame, its resolution, its classes.

    The reference frame is the ego's sensor frame: x forward, y left, metres.
    """

    name: str
    half_x_m: float
    half_y_m: float
    low_z_m: float
    high_z_m: float
    pillar_m: float
    labels: tuple[str, ...]
    symmetry: tuple[int, ...]
    """For each class, by how many equal turns its footprint looks the same: 2 for a rectangle, 4
    for a square. Headings are learned modulo these, since nothing in a scan tells them apart."""

    @property
    def columns(self) -> int:
        """Pillars along x."""
        return round(2 * self.half_x_m / self.pillar_m)

    @property
    def rows(self) -> int:
        """Pillars along y."""
        return round(2 * self.half_y_m / self.pillar_m)

    @property
    def cell_m(self) -> float:
        """Side of a cell of the feature map, metres."""
        return self.pillar_m * STRIDE

    @property
    def cells(self) -> tuple[int, int]:
        """Rows (y) and columns (x) of the feature map."""
        return self.rows // STRIDE, self.columns // STRIDE


_FACTORY = BevConfig(
    # Robots' LiDARs stand 1.2 m above the floor; nothing that is looked for is higher than 2.3 m.
    name="factory",
    half_x_m=25.6,
    half_y_m=25.6,
    low_z_m=-1.5,
    high_z_m=1.7,
    pillar_m=0.2,
    labels=("person", "robot", "forklift"),
    symmetry=(4, 2, 2),
)
_ROAD = BevConfig(
    # OPV2V's range of evaluation. Its LiDARs stand 1.9 m above the road, which may rise and fall.
    name="road",
    half_x_m=140.8,
    half_y_m=40.0,
    low_z_m=-4.0,
    high_z_m=2.0,
    pillar_m=0.4,
    labels=("vehicle",),
    symmetry=(2,),
)
_CONFIGS = {config.name: config for config in (_FACTORY, _ROAD)}


def bev_config(name: str) -> BevConfig:
    """The configuration of that name. Raises PerceptionError for an unknown one."""
    if name not in _CONFIGS:
        raise PerceptionError(
            f"detector configuration {name!r} is not known; allowed: {', '.join(_CONFIGS)}"
        )
    return _CONFIGS[name]
