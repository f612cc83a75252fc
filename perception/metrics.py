"""Average precision of detected boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.boxes import iou_bev
from perception.types import Boxes


def average_precision(frames: Sequence[tuple[Boxes, Boxes]], min_iou: float) -> float:
    """AP over frames of (detected, true) boxes, matched by rotated IoU in BEV.

    Detections of all frames are ranked together by score; each takes the free true box of its
    frame that it overlaps most, if by at least `min_iou`. The precision is made monotonous and
    integrated over all recall steps (PASCAL VOC 2010 and later). 0 when there is no true box.
    """
    total = sum(len(truth) for _, truth in frames)
    overlaps = [iou_bev(found, truth) for found, truth in frames]
    taken = [np.zeros(len(truth), dtype=np.bool_) for _, truth in frames]
    ranked = sorted(
        (
            (-float(score), frame, index)
            for frame, (found, _) in enumerate(frames)
            for index, score in enumerate(found.scores)
        ),
    )
    hits = np.zeros(len(ranked))
    for rank, (_, frame, index) in enumerate(ranked):
        free = np.where(taken[frame], -1.0, overlaps[frame][index])
        if len(free) and free.max() >= min_iou:
            taken[frame][int(free.argmax())] = True
            hits[rank] = 1.0
    if not total or not len(hits):
        return 0.0
    true_positives = np.cumsum(hits)
    recall = true_positives / total
    precision = true_positives / np.arange(1, len(hits) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))
