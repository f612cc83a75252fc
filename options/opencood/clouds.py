"""Scans as OpenCOOD's networks know them: left-handed, with intensity, without the own body.

Everything outside this package is right-handed. OPV2V was recorded in CARLA, whose y axis points
right, and the networks were trained on that: `network_cloud` mirrors points on the way in, and
`mirrored` mirrors boxes on the way out.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes, clean_points
from swarm.geometry import TWO_PI, Matrix, Points, transform

ATTENUATION_PER_M = 0.004
"""CARLA's default for air: a return has intensity exp(-a distance). OPV2V's files hold just that,
in steps of 1/255, so that it need not travel."""
BODY_X_M = (-1.95, 2.95)
BODY_Y_M = (-1.1, 1.1)
"""Where OpenCOOD takes points for returns from the sensor's own vehicle, at any height."""
CHUNK = 500_000


def network_cloud(
    points: Points, here_from_sensor: Matrix | None = None
) -> Iterator[NDArray[np.float32]]:
    """A scan as x, y, z, intensity in the network's frame, in chunks of float32 (n, 4).

    `points` (N, 3) are in the sensor's right-handed frame, metres; points that are not finite are
    left out. `here_from_sensor` leads to the frame of detection, by default the sensor's own.
    Raises ScanError when the points are not (N, 3).
    """
    yield np.zeros((0, 4), dtype=np.float32)
    clean_points(points[:0])
    for start in range(0, len(points), CHUNK):
        cloud = clean_points(points[start : start + CHUNK])
        x, y = cloud[:, 0], cloud[:, 1]
        own = (x >= BODY_X_M[0]) & (x <= BODY_X_M[1]) & (y >= BODY_Y_M[0]) & (y <= BODY_Y_M[1])
        cloud = cloud[~own]
        # In float64: the square of a stray return far away overflows otherwise.
        distance = np.sqrt(np.square(cloud, dtype=np.float64).sum(axis=1))
        placed = cloud if here_from_sensor is None else transform(here_from_sensor, cloud)
        out = np.empty((len(cloud), 4), dtype=np.float32)
        out[:, :3] = placed * np.array([1, -1, 1], dtype=np.float32)
        out[:, 3] = np.exp(-ATTENUATION_PER_M * distance)
        yield out


def mirrored(boxes: Boxes) -> Boxes:
    """Boxes of a left-handed frame in the right-handed one with the same x and z, or back."""
    return Boxes(
        boxes.centers * [1.0, -1.0, 1.0],
        boxes.sizes,
        np.remainder(-boxes.headings, TWO_PI) % TWO_PI,
        boxes.scores,
        boxes.labels,
    )
