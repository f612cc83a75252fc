"""The interface of a world: a source of scans and ground truth, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from perception.detector import configuration
from perception.types import Boxes
from swarm.body import Body
from swarm.geometry import Points, Pose


@dataclass(frozen=True, slots=True, repr=False)
class Scan:
    """What one robot's LiDAR sees in one frame."""

    robot: str
    frame: int
    points: Points
    """float32 (N, 3), metres, in the sensor's right-handed frame."""
    pose: Pose
    """The sensor in the world frame."""
    velocity: tuple[float, float, float]
    """World frame, m/s."""
    captured_ns: int | None = None
    """When it was taken, on this machine's clock, nanoseconds since the Unix epoch; None: at the
    moment of its frame. A live robot's scans come when they come."""

    def __repr__(self) -> str:
        at = f"{self.pose.x:.2f}, {self.pose.y:.2f}, {self.pose.z:.2f}"
        return f"Scan({self.robot} in frame {self.frame}: {len(self.points)} points, at ({at}) m)"


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """True boxes of one frame in the world frame."""

    boxes: Boxes
    """Scores are 1."""
    ids: tuple[str, ...]
    """Name of the actor of each box; a robot's own body carries the robot's id."""
    visible_points: NDArray[np.int64]
    """(N,): points of all the world's robots' scans that lie on the actor."""


class World(Protocol):
    """A source of scans. A robot needs only its own scans: no central simulator runs."""

    name: str
    robots: tuple[str, ...]
    rate_hz: float
    """Frames a second."""
    frame_count: int
    """Frames before the world repeats; frame numbers beyond wrap around."""
    range_m: float
    """Reach of the sensors."""
    detector: str
    """Name of the detector configuration that fits this world: `road` or `factory`."""

    def pose(self, robot: str, frame: int) -> Pose:
        """The robot's sensor in the world frame. Raises WorldError for an unknown robot."""
        ...

    def scan(self, robot: str, frame: int) -> Scan:
        """One scan. Raises WorldError when it cannot be read or the robot is unknown."""
        ...

    def ground_truth(self, frame: int) -> GroundTruth:
        """The true boxes of one frame."""
        ...


class SelfDescribing:
    """A world that says what it is where somebody prints it."""

    def __repr__(self: World) -> str:
        return (
            f"{type(self).__name__}({', '.join(self.robots[:4])}"
            f"{', ...' if len(self.robots) > 4 else ''}; {self.frame_count} frames at "
            f"{self.rate_hz:g} Hz, detector {self.detector})"
        )


@dataclass(frozen=True, slots=True)
class Rays:
    """The rays of a spinning sensor that measures in steps: a scan of it is a range image."""

    directions: NDArray[np.float32]
    """(rings, columns, 3): unit vectors in the sensor's frame; rings from the lowest, columns
    evenly around from azimuth 0. A point is a direction times a range, both float32; a scan's
    points come ring by ring."""
    step_m: float
    """Ranges are whole multiples of it."""


@runtime_checkable
class Rayed(Protocol):
    """A world that knows the rays of its sensors."""

    def rays(self) -> Rays | None:
        """The same for all robots; None where scans are no range images."""
        ...


@runtime_checkable
class Embodied(Protocol):
    """A world that knows what its robots look like."""

    def body(self, robot: str) -> Body:
        """The robot's body. Raises WorldError for an unknown robot."""
        ...


def body_of(world: World, robot: str) -> Body:
    """What a robot of the world looks like: the usual body of its detector's robots where the world
    does not say."""
    if isinstance(world, Embodied):
        return world.body(robot)
    return configuration(world.detector).usual_body


@runtime_checkable
class Ranged(Protocol):
    """A world whose data says how far from the ego a robot may take part."""

    comm_range_m: float | None
    """None where it does not say it."""


def comm_range_of(world: World) -> float:
    """How far from the ego a robot may take part, metres: what the data says, else what is usual
    with the world's detector."""
    told = world.comm_range_m if isinstance(world, Ranged) else None
    return told or configuration(world.detector).comm_range_m
