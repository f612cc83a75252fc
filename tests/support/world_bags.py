"""Bags of the robots of a world: what each would have recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from swarm.geometry import pose_of
from tests.support.bag_files import CLOUD, MOUNT, ODOMETRY, Log, cloud, ns, odometry
from worlds.base import World

MOUNTED = np.linalg.inv(MOUNT["base_link", "lidar"].matrix())
ROAD_SEED = 24
"""Of a street whose R2 is 60 m from R1 for its first two seconds."""


def write_bags(
    folder: Path,
    world: World,
    frames: Sequence[int],
    ahead_s: Mapping[str, float] | None = None,
    storage: str = "mcap",
) -> Path:
    """One bag a robot, by odometry and tf_static, frame k at k / rate_hz.

    `ahead_s`: how far a robot's clock is ahead; stamps and recording go by it.
    """
    for robot in world.robots:
        ahead = (ahead_s or {}).get(robot, 0.0)
        log = Log().tf(ahead, MOUNT, static=True)
        for frame in frames:
            stamp, scan = ns(frame / world.rate_hz + ahead), world.scan(robot, frame)
            base = pose_of(scan.pose.matrix() @ MOUNTED)
            x, y, z = map(float, scan.pose.matrix()[:3, :3].T @ np.array(scan.velocity))
            log.add("/points", CLOUD, stamp, cloud(stamp, scan.points))
            log.add("/odom", ODOMETRY, stamp, odometry(stamp, base, (x, y, z)))
        log.write(folder / robot, storage)
    return folder
