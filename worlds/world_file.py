"""`world.toml`: what recorded data does not say about itself, checked."""

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
Rate = Annotated[float, msgspec.Meta(gt=0, le=100)]
Range = Annotated[float, msgspec.Meta(gt=0, le=10_000)]
Age = Annotated[float, msgspec.Meta(gt=0, le=60)]
Offset = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
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


class WorldFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What every kind of recorded data may be told."""

    detector: str | None = None
    """The name of a detector configuration; None takes what suits the scans best."""
    comm_range_m: Range | None = None
    """How far from the ego a robot may take part; None: as is usual with the detector."""
    rate_hz: Rate | None = None
    """Frames a second; None takes what the data says."""
    robots: dict[str, dict[str, Any]] = {}
    """What is said of each robot."""


W = TypeVar("W", bound=WorldFile)


def read_world_file(folder: Path, kind: type[W], of_robot: type[S], robots: tuple[str, ...]) -> W:
    """The settings of a folder; the defaults where it has no file of them.

    Args:
        folder: of the recorded data.
        kind: what the file may say.
        of_robot: what it may say of a robot.
        robots: whose data is there.

    Raises WorldError that names the file, the key and what is allowed.
    """
    path = folder / FILE_NAME
    try:
        values = tomllib.loads(path.read_text())
    except FileNotFoundError:
        return kind()
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise WorldError(f"{path} cannot be read: {error}") from error
    settings = _checked(values, kind, path, "")
    if settings.detector is not None and settings.detector not in configurations():
        raise WorldError(
            f"detector = {settings.detector!r} in {path} is not known; allowed: "
            f"{', '.join(configurations())}"
        )
    for name in settings.robots:
        if name not in robots:
            raise WorldError(
                f"{path} names robot {name!r}, which has no data; there are {', '.join(robots)}"
            )
        settings_of(settings, name, of_robot, path)
    return settings


def settings_of(settings: WorldFile, robot: str, kind: type[S], path: Path) -> S:
    """What is said of one robot. Raises WorldError that names a wrong value."""
    return _checked(settings.robots.get(robot, {}), kind, path, f"robots.{robot}")


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
