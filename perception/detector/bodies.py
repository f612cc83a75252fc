"""Bodies of the robots that points were merged from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm.body import Body
from swarm.geometry import Matrix, Points, invert, transform

BODY_MARGIN_M = 0.3
"""Points this far from a body, seen from above, are still taken as its own: errors of poses and
of coded points."""


def without_bodies(points: Points, here_from_sensors: Sequence[Matrix], body: Body) -> Points:
    """The points (N, 3) that do not lie on one of the senders' own bodies, seen from above.

    Whoever carries a sensor would be completed away from it, as if it had been seen from outside.
    """
    half = np.array(body.size[:2]) / 2 + BODY_MARGIN_M
    reach = np.float32(np.hypot(*half) + np.hypot(*body.center[:2]))
    kept = np.ones(len(points), dtype=np.bool_)
    # By column: reducing over pairs would cost ten times as much as all the rest.
    x, y = np.ascontiguousarray(points[:, :2].T)
    for matrix in here_from_sensors:
        x0, y0 = matrix[:2, 3].astype(np.float32)
        near = np.flatnonzero((np.abs(x - x0) <= reach) & (np.abs(y - y0) <= reach))
        local = transform(invert(matrix), points[near])[:, :2] - body.center[:2]
        kept[near] &= (np.abs(local) > half).any(axis=1)
    return points[kept]
