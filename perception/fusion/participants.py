"""The robots that take part are objects too, at places that need no detection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.boxes import iou_bev
from perception.detector.config import Carrier
from perception.types import Boxes
from swarm.geometry import Matrix

SAME_OBJECT_IOU = 0.1
"""Two solid bodies do not overlap: a box that shares this much with a participant shows it."""


def without_own(
    found: Boxes, own_body_m: float, stood_at: tuple[float, float] = (0.0, 0.0)
) -> Boxes:
    """Boxes in the ego's frame without the ego, whom others see where it stood: it does not report
    itself."""
    return found.take(np.hypot(*(found.centers[:, :2] - stood_at).T) > own_body_m)


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
