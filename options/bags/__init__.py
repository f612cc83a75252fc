"""Robots' own logs as a world: rosbag2 and MCAP, one bag a robot, read without ROS."""

from __future__ import annotations

from pathlib import Path

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest


def _open(request: WorldRequest) -> World:
    from options.bags.world import BagWorld

    return BagWorld(Path(request.data))


WORLDS = (WorldKind("bag", _open, "directory", "the directory of the robots' bags"),)
