"""The robots that take part are objects too, at places that need no detection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.boxes import iou_bev
from perception.detector import Carrier
from perception.types import Boxes
from swarm.geometry import Matrix, Points, invert, transform

SAME_OBJECT_IOU = 0.1
"""Two solid bodies do not overlap: a box that shares this much with a participant shows it."""
BODY_MARGIN_M = 0.3
"""Points this far from a body, seen from above, are still taken as its own: errors of poses and
of coded points."""


def without_bodies(points: Points, here_from_sensors: Sequence[Matrix], carrier: Carrier) -> Points:
    """The points (N, 3) that do not lie on one of the senders' own bodies, seen from above.

    Whoever carries a sensor would be completed away from it, as if it had been seen from outside.
    """
    half = np.array(carrier.size[:2]) / 2 + BODY_MARGIN_M
    reach = np.float32(np.hypot(*half) + np.hypot(*carrier.center[:2]))
    kept = np.ones(len(points), dtype=np.bool_)
    # By column: reducing over pairs would cost ten times as much as all the rest.
    x, y = np.ascontiguousarray(points[:, :2].T)
    for matrix in here_from_sensors:
        x0, y0 = matrix[:2, 3].astype(np.float32)
        near = np.flatnonzero((np.abs(x - x0) <= reach) & (np.abs(y - y0) <= reach))
        local = transform(invert(matrix), points[near])[:, :2] - carrier.center[:2]
        kept[near] &= (np.abs(local) > half).any(axis=1)
    return points[kept]


def without_own(found: Boxes, own_body_m: float) -> Boxes:
    """Boxes in the ego's frame without the ego, whom others see: it does not report itself."""
    return found.take(np.hypot(*found.centers[:, :2].T) > own_body_m)


def with_participants(found: Boxes, here_from_sensors: Sequence[Matrix], carrier: Carrier) -> Boxes:
    """Fused boxes with one box for each sender's own body, in place of those that overlap it.

    A sensor sees little of what carries it, often two pieces that nothing connects, while its pose
    comes with every contribution. `found` and the result are in one frame, "here".
    """
    body = Boxes(
        centers=np.array([carrier.center]),
        sizes=np.array([carrier.size]),
        headings=np.zeros(1),
        scores=np.ones(1),
        labels=(carrier.label,),
    )
    bodies = Boxes.concatenate([body.transformed(matrix) for matrix in here_from_sensors])
    shared = iou_bev(found, bodies).max(axis=1, initial=0.0)
    return Boxes.concatenate([bodies, found.take(shared <= SAME_OBJECT_IOU)])
