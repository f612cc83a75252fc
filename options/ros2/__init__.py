"""A live ROS 2 robot as a world: its scans and poses over rmw_zenoh, without ROS."""

from __future__ import annotations

from swarm.errors import WorldError
from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest

FORM = "ros2://HOST[:PORT]/DOMAIN?points=/TOPIC&odom=/TOPIC (or tf=/tf)"


def _open(request: WorldRequest) -> World:
    from options.ros2.address import parse
    from options.ros2.world import LiveWorld

    if request.reader is None:
        raise WorldError("world 'ros2' is a live robot: it belongs to one process")
    reader = request.reader
    return LiveWorld(parse(request.data), reader.robot, reader.process, reader.log)


WORLDS = (WorldKind("ros2", _open, "address", f"the robot's address: {FORM}"),)
