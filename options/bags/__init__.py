"""Robots' own logs as a world: rosbag2 and MCAP, one bag a robot, read without ROS."""

from __future__ import annotations

from pathlib import Path

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest, robot_count


def _open(request: WorldRequest) -> World:
    from options.bags.world import BagWorld

    return BagWorld(Path(request.data))


def _found(path: Path) -> str:
    from options.bags.recording import find_bags

    bags = find_bags(path) if path.is_dir() else {}
    return f"bags of {robot_count(len(bags))}" if bags else ""


NEEDS = "the directory of the robots' bags"
WORLDS = (WorldKind("bag", _open, "directory", NEEDS, found=_found),)
