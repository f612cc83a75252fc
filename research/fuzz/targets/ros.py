"""Target: what a ROS 2 robot publishes, and what rmw_zenoh puts beside it."""

from __future__ import annotations

import numpy as np

from options.recordings.clouds import read_points
from options.ros.cdr import CdrError
from options.ros.messages import (
    read_cloud,
    read_frame,
    read_odometry,
    read_stamp,
    read_transforms,
)
from options.ros2.address import parse
from options.ros2.keys import read_attachment, read_publisher
from research.fuzz.target import Target
from swarm.errors import SettingError, WorldError


def _take(data: bytes) -> None:
    """One byte for the reader, the rest is what it reads."""
    if not data:
        return
    body = data[1:]
    match data[0] % 7:
        case 0:
            cloud = read_cloud(body)
            assert np.isfinite(cloud.points).all()
            assert not cloud.points.flags.writeable
        case 1:
            assert read_odometry(body).transform.parent == read_frame(body)
        case 2:
            read_transforms(body)
        case 3:
            read_stamp(body[:12])
        case 4:
            assert read_points(body).shape[1] == 3
        case 5:
            read_attachment(body)
            read_publisher(body.decode("latin-1"))
        case 6:
            parse("ros2://" + body.decode("utf-8", errors="replace"))


ROS = Target(_take, (CdrError, WorldError, SettingError))
