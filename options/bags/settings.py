"""`world.toml`: what bags do not say about themselves."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from perception.detector.config import configurations
from swarm.errors import WorldError
from swarm.geometry import Pose

FILE_NAME = "world.toml"
Seconds = Annotated[float, msgspec.Meta(gt=0, le=60)]
S = TypeVar("S", bound=msgspec.Struct)


class Place(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A pose: metres, and radians about z, y, x (yaw last to first)."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def pose(self) -> Pose:
        """The same as a pose."""
        return Pose(self.x, self.y, self.z, self.roll, self.pitch, self.yaw)


class RobotSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Of one robot."""

    points: str = ""
    """The topic of its scans; empty takes the only PointCloud2."""
    odometry: str = ""
    """The topic that says where it is; empty takes tf, or else the only Odometry."""
    sensor: Place | None = None
    """The LiDAR on the robot, in place of what tf says."""
    origin: Place = Place()
    """Where the robot's fixed frame (its odometry's or tf's) lies in the world."""
    clock_offset_s: Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)] | None = None
    """How far its clock is ahead of the other robots'; None: nobody has looked."""


class WorldSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Of the world."""

    detector: str | None = None
    """The name of a detector configuration; None takes what suits the scans best."""
    comm_range_m: Annotated[float, msgspec.Meta(gt=0, le=10_000)] | None = None
    """How far from the ego a robot may take part; None: as is usual with the detector."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=100)] | None = None
    """Frames a second; None takes the median rate of the robots' scans."""
    max_scan_age_s: Seconds = 0.5
    """A frame in which a robot's newest scan is older sees nothing of that robot."""
    robots: dict[str, dict[str, Any]] = {}

    def robot(self, name: str, path: Path) -> RobotSettings:
        """The settings of one robot. Raises WorldError that names a wrong value."""
        return _checked(self.robots.get(name, {}), RobotSettings, path, f"robots.{name}")


def read_settings(folder: Path, robots: tuple[str, ...]) -> WorldSettings:
    """The settings of a folder of bags; the defaults where it has no file of them.

    Raises WorldError that names the file, the key and what is allowed.
    """
    path = folder / FILE_NAME
    try:
        values = tomllib.loads(path.read_text())
    except FileNotFoundError:
        return WorldSettings()
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise WorldError(f"{path} cannot be read: {error}") from error
    settings = _checked(values, WorldSettings, path, "")
    if settings.detector is not None and settings.detector not in configurations():
        raise WorldError(
            f"detector = {settings.detector!r} in {path} is not known; allowed: "
            f"{', '.join(configurations())}"
        )
    for name in settings.robots:
        if name not in robots:
            raise WorldError(
                f"{path} names robot {name!r}, which has no bag; there are {', '.join(robots)}"
            )
        settings.robot(name, path)
    return settings


def _checked(values: dict[str, Any], kind: type[S], path: Path, where: str) -> S:
    prefix = f"[{where}] of {path}" if where else str(path)
    known = [field.name for field in msgspec.structs.fields(kind)]
    for name in values:
        if name not in known:
            raise WorldError(f"{prefix} has the key {name!r}; allowed: {', '.join(known)}")
    for name, value in values.items():
        field = next(field for field in msgspec.structs.fields(kind) if field.name == name)
        try:
            checked = msgspec.convert(value, field.type)
        except msgspec.ValidationError as error:
            raise WorldError(f"{name} = {value!r} in {prefix} is not valid: {error}") from error
        numbers = msgspec.structs.astuple(checked) if isinstance(checked, Place) else (checked,)
        if not all(math.isfinite(number) for number in numbers if isinstance(number, float)):
            raise WorldError(f"{name} = {value!r} in {prefix} is not valid: it is not finite")
    return msgspec.convert(values, kind)
