"""`world.toml`: what bags do not say about themselves."""

from __future__ import annotations

from pathlib import Path

import msgspec

from worlds.world_file import FILE_NAME, Age, Offset, Place, WorldFile, read_world_file, settings_of


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
    clock_offset_s: Offset | None = None
    """How far its clock is ahead of the other robots'; None: nobody has looked."""


class WorldSettings(WorldFile, frozen=True, forbid_unknown_fields=True):
    """Of the world; its rate is the median one of the robots' scans where none is named."""

    max_scan_age_s: Age = 0.5
    """A frame in which a robot's newest scan is older sees nothing of that robot."""

    def robot(self, name: str, folder: Path) -> RobotSettings:
        """The settings of one robot. Raises WorldError that names a wrong value."""
        return settings_of(self, name, RobotSettings, folder / FILE_NAME)


def read_settings(folder: Path, robots: tuple[str, ...]) -> WorldSettings:
    """The settings of a folder of bags; the defaults where it has no file of them.

    Raises WorldError that names the file, the key and what is allowed.
    """
    return read_world_file(folder, WorldSettings, RobotSettings, robots)
