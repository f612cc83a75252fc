"""Detector configurations by name: which classes of object exist, and how large they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from perception.scene.clusters import ObjectLimits
from swarm.body import Body
from swarm.errors import PerceptionError

CLUSTER_SLACK_M = 0.2
"""By which clusters may be larger than objects are, as clutter clings to them, or lower."""


@dataclass(frozen=True, slots=True)
class ObjectClass:
    """Usual dimensions of one class and the range in which a cluster can be one, metres."""

    label: str
    size: tuple[float, float, float]
    """Usual length, width, height."""
    max_size: tuple[float, float, float]
    min_height: float
    """A cluster lower than this above the ground is not one."""
    min_length: float
    """Longest visible side that a partly hidden one still shows."""


@dataclass(frozen=True, slots=True)
class SensorFacts:
    """The LiDARs that a detector was trained on, and others that it still does well with.

    Moved up or down, or with each second to eighth point alone, the scans of its own world are
    within these limits fused to an AP@0.7 of 0.8 at least (`early`; unchanged it is 0.97 and 1).
    """

    height_m: float
    """Over the ground."""
    heights_m: tuple[float, float]
    reaches_m: tuple[float, float]
    """Within which 99 % of a scan's points lie, seen from above: beyond the limits, scans are of
    another kind of place. docs/worlds.md tells those of trained scans."""
    min_points: int
    """Of a scan."""
    range_m: float
    """Reach of a real sensor that it reads."""


@dataclass(frozen=True, slots=True)
class DetectorConfig:
    """What `detect` looks for."""

    name: str
    classes: tuple[ObjectClass, ...]
    min_points: int
    sure_points: int
    """From this many points on, the number of points no longer lowers the score."""
    size_slack_m: float
    """A side up to this much longer than usual is taken as usual: range noise and the codec's error
    (0.1 m a point by default) widen what is seen. 0 where a class has many models."""
    usual_body: Body
    """Of a robot that announces none."""
    own_body_m: float
    """Boxes with their centre this close to the sensor, seen from above, are the robot itself."""
    usual_speed_m_s: float
    """Standard deviation of the objects' velocities along an axis."""
    sensor: SensorFacts
    comm_range_m: float
    """How far from the ego a robot may take part, where nobody says."""
    fuses_cells_by: Literal["attention", "strongest"]
    """How chosen cells of feature maps are fused (perception.fusion.maps)."""
    sparse_structure: bool
    """Whether little is sent of what is too tall to be an object, and whether, where the ego wants
    no more, nothing is of all that cannot be one."""

    @property
    def tallest_m(self) -> float:
        """No object is taller."""
        return max(one.max_size[2] for one in self.classes)

    @property
    def limits(self) -> ObjectLimits:
        """Of clusters that may be objects: all that may be one of the classes, partly hidden."""
        longest = max(math.hypot(*one.max_size[:2]) for one in self.classes)
        low = min(one.min_height for one in self.classes)
        return ObjectLimits(
            longest=longest + CLUSTER_SLACK_M,
            low=low - CLUSTER_SLACK_M,
            tall=self.tallest_m + CLUSTER_SLACK_M,
            own_body=self.own_body_m,
        )


_ROAD = DetectorConfig(
    name="road",
    # Passenger cars: median of the EuroNCAP "large family" and "supermini" classes is about
    # 4.5 x 1.85 x 1.5 m; vans and small trucks reach the maximum.
    classes=(
        ObjectClass("vehicle", (4.5, 1.95, 1.55), (7.5, 2.9, 3.2), min_height=0.6, min_length=0.7),
    ),
    min_points=8,
    sure_points=80,
    size_slack_m=0.0,
    # All recording vehicles of OPV2V are CARLA's Lincoln MKZ 2017, with the LiDAR 1.9 m above the
    # ground and 0.5 m behind the middle.
    usual_body=Body(label="vehicle", size=(4.9, 2.13, 1.51), center=(0.5, 0.0, -1.18)),
    own_body_m=2.1,
    usual_speed_m_s=6.0,
    sensor=SensorFacts(1.9, (1.5, 2.3), (25.0, 250.0), min_points=14_000, range_m=120.0),
    # OpenCOOD evaluates OPV2V with it (its COM_RANGE).
    comm_range_m=70.0,
    # The strongest feature is worth 0.03 more of AP@0.7 with right poses, and less with poses off
    # by 0.2 m: 0.03, by 0.4 m: 0.11 (streets of seeds from 1,960,100 on).
    fuses_cells_by="attention",
    # It would save 4 % of the bytes on streets, 2 % on real frames, which lose 0.003 of AP@0.7.
    sparse_structure=False,
)
_FACTORY = DetectorConfig(
    name="factory",
    # Sizes of the simulated actors, worlds/factory/. The limits leave room for noise and no more:
    # there are machines and goods of almost any size. A robot shows its mast.
    classes=(
        ObjectClass("person", (0.5, 0.5, 1.75), (0.8, 0.8, 2.0), min_height=1.35, min_length=0.2),
        ObjectClass("robot", (0.9, 0.6, 1.26), (1.15, 0.85, 1.4), min_height=0.9, min_length=0.3),
        ObjectClass("forklift", (2.5, 1.2, 2.1), (2.75, 1.45, 2.3), min_height=1.8, min_length=0.9),
    ),
    min_points=8,
    sure_points=60,
    size_slack_m=0.2,
    # worlds/factory/actors.py: the LiDAR stands in the middle, 1.2 m above the floor.
    usual_body=Body(label="robot", size=(0.9, 0.6, 1.26), center=(0.0, 0.0, -0.57)),
    own_body_m=0.6,
    usual_speed_m_s=1.0,
    sensor=SensorFacts(1.2, (1.0, 1.6), (5.0, 60.0), min_points=3_500, range_m=40.0),
    # The paper's com_range_m in most scenes.
    comm_range_m=45.0,
    # Worth 0.04 more of AP@0.7 than attention, with poses off by up to 0.2 m, and as much at 0.4 m
    # (floors of seeds from 1,960,100 on).
    fuses_cells_by="strongest",
    # It saves a sixth of the bytes for as much AP@0.7, and has a few more false boxes
    # (docs/results.md).
    sparse_structure=True,
)
_CONFIGURATIONS = {config.name: config for config in (_ROAD, _FACTORY)}


def configurations() -> tuple[str, ...]:
    """The names of all."""
    return tuple(_CONFIGURATIONS)


def configuration(name: str) -> DetectorConfig:
    """The configuration of that name. Raises PerceptionError for an unknown one."""
    if name not in _CONFIGURATIONS:
        raise PerceptionError(
            f"detector configuration {name!r} is not known; allowed: {', '.join(_CONFIGURATIONS)}"
        )
    return _CONFIGURATIONS[name]
