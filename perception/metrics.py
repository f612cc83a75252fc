"""Average precision of detected boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.boxes import iou_bev
from perception.types import Boxes


@dataclass(frozen=True, slots=True)
class Match:
    """Detected boxes of one frame against its true ones, best score first."""

    scores: NDArray[np.float64]
    hits: NDArray[np.bool_]
    """Whether each detection has found a true box that no better one had."""
    truths: int


def match(found: Boxes, truth: Boxes, min_iou: float) -> Match:
    """Each detection, best first, takes the free true box that it overlaps most (rotated IoU in
    BEV), if by at least `min_iou`."""
    order = np.argsort(-found.scores, kind="stable")
    overlap = iou_bev(found.take(order), truth)
    hits = np.zeros(len(order), dtype=np.bool_)
    for rank in np.flatnonzero(overlap.max(axis=1, initial=0.0) >= min_iou):
        best = int(overlap[rank].argmax())
        if overlap[rank, best] >= min_iou:
            hits[rank] = True
            overlap[:, best] = -1.0
    return Match(found.scores[order], hits, len(truth))


def precision_of(
    matches: Sequence[Match], *, per_frame: bool = False, weights: Sequence[float] | None = None
) -> float:
    """AP of matched frames: the precision is made monotonous and integrated over all recall steps
    (PASCAL VOC 2010 and later). 0 when there is no true box.

    Detections of all frames are ranked together by score. With `per_frame` they stay in the order
    of their frames, ranked within each frame only: what OpenCOOD's code computes by default and
    its published tables hold. It depends on the order of the frames, and is usually lower.
    `weights`: how often each frame counts, all once where None.
    """
    weights = [1.0] * len(matches) if weights is None else weights
    total = sum(weight * one.truths for weight, one in zip(weights, matches, strict=True))
    counts = np.repeat(np.asarray(weights, np.float64), [len(one.hits) for one in matches])
    hits = np.concatenate([np.zeros(0, np.bool_), *(one.hits for one in matches)])
    if not total or not len(hits):
        return 0.0
    if not per_frame:
        scores = np.concatenate([one.scores for one in matches])
        order = np.argsort(-scores, kind="stable")
        hits, counts = hits[order], counts[order]
    true_positives = np.cumsum(counts * hits)
    recall = true_positives / total
    precision = true_positives / np.cumsum(counts)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))


def average_precision(frames: Sequence[tuple[Boxes, Boxes]], min_iou: float) -> float:
    """AP over frames of (detected, true) boxes, all detections ranked together by score."""
    return precision_of([match(found, truth, min_iou) for found, truth in frames])


def average_precision_per_frame(frames: Sequence[tuple[Boxes, Boxes]], min_iou: float) -> float:
    """AP as OpenCOOD's published tables have it: detections ranked within their frame only, frame
    after frame (see `precision_of`)."""
    matches = [match(found, truth, min_iou) for found, truth in frames]
    return precision_of(matches, per_frame=True)
