"""From score and offset maps to boxes, in the network's left-handed frame.

Offsets are those of SECOND (Yan et al., 2018): x, y in diagonals of the anchor, z in its height,
sizes as logarithms, yaw as a difference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from options.opencood.config import OpenCoodConfig
from perception.boxes import footprints, nms
from perception.types import Boxes
from swarm.geometry import TWO_PI

LABEL = "vehicle"
ANCHOR_Z_M = -1.0
MAX_EXTENT_M = 6.0
"""Along x and along y; whatever reaches further is taken for an error, buses included."""
Z_RANGE_M = (-3.0, 1.0)
EVALUATED_RANGE_M = (140.0, 40.0)
"""OpenCOOD reports boxes whose corners lie within +-140 m in x and +-40 m in y of the ego."""
MAX_RANKED = 1000


def decode(
    logits: NDArray[np.float32], offsets: NDArray[np.float32], config: OpenCoodConfig
) -> Boxes:
    """All boxes above the score threshold: logits (A, H, W), offsets (7 A, H, W)."""
    anchors, rows, columns = logits.shape
    scores = 1.0 / (1.0 + np.exp(-np.clip(logits, -80, 80).astype(np.float64)))
    index, row, column = np.nonzero(scores > config.score_threshold)
    delta = offsets.reshape(anchors, 7, rows, columns)[index, :, row, column].astype(np.float64)
    low, high, step = config.lidar_range[:2], config.lidar_range[3:5], config.voxel_size
    # OpenCOOD puts the outer anchors one pillar from the border, whatever the stride.
    x = np.linspace(low[0] + step[0], high[0] - step[0], columns)[column]
    y = np.linspace(low[1] + step[1], high[1] - step[1], rows)[row]
    length, width, height = config.anchor_size
    diagonal = np.hypot(length, width)
    centers = np.stack(
        [x + delta[:, 0] * diagonal, y + delta[:, 1] * diagonal, ANCHOR_Z_M + delta[:, 2] * height],
        axis=1,
    )
    # Wild logarithms become sizes that `sound` refuses, not infinity.
    sizes = np.exp(np.clip(delta[:, [5, 4, 3]], -20, 20)) * [length, width, height]
    headings = np.array(config.anchor_yaws)[index] + delta[:, 6]
    finite = np.flatnonzero(np.isfinite(delta).all(axis=1))
    found = Boxes(
        centers, sizes, headings % TWO_PI % TWO_PI, scores[index, row, column], (LABEL,) * len(x)
    )
    return found.take(finite)


def best(boxes: Boxes, nms_threshold: float) -> Boxes:
    """What OpenCOOD reports of boxes in the ego's frame: sound ones, without duplicates."""
    ranked = boxes.take(sound(boxes))
    ranked = ranked.take(np.argsort(-ranked.scores, kind="stable")[:MAX_RANKED])
    kept = nms(ranked, nms_threshold)
    reach = np.abs(footprints(kept)).max(axis=1)
    inside: NDArray[np.bool_] = (reach <= EVALUATED_RANGE_M).all(axis=1)
    return kept.take(inside)


def sound(boxes: Boxes) -> NDArray[np.bool_]:
    """(N,) which boxes have a vehicle's extent and height above the sensor."""
    corners = footprints(boxes)
    extent = corners.max(axis=1) - corners.min(axis=1)
    bottom, top = (boxes.centers[:, 2] + sign * boxes.sizes[:, 2] / 2 for sign in (-1, 1))
    small: NDArray[np.bool_] = (extent <= MAX_EXTENT_M).all(axis=1)
    return small & (bottom >= Z_RANGE_M[0]) & (top <= Z_RANGE_M[1]) & (boxes.sizes[:, 2] > 0)
