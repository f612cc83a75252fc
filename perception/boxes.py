"""Overlap of oriented boxes, and merging boxes that show one object.

Boxes stand upright: they turn about z only. Overlap "in BEV" is that of the footprints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.geometry import wrap_heading

Floats = NDArray[np.float64]
_CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2.0
_EPSILON = 1e-9
SHARPNESS = 8
"""Of the weights of boxes that are merged: score ** SHARPNESS. A view that is a little surer shows
the object a good deal better, and the mean of a good and a bad box is a bad one."""
_PAIRS = 8192
"""Pairs at once: each takes about 4 kB while its overlap is computed."""


def footprints(boxes: Boxes) -> Floats:
    """Corners of the footprints, float64 (N, 4, 2), counter-clockwise, metres."""
    local = _CORNERS[None] * boxes.sizes[:, None, :2]
    cos, sin = np.cos(boxes.headings)[:, None], np.sin(boxes.headings)[:, None]
    x = cos * local[..., 0] - sin * local[..., 1] + boxes.centers[:, None, 0]
    y = sin * local[..., 0] + cos * local[..., 1] + boxes.centers[:, None, 1]
    return np.stack([x, y], axis=-1)


def iou_bev(a: Boxes, b: Boxes) -> Floats:
    """Intersection over union of the footprints of N and M boxes: float64 (N, M)."""
    near = _within_reach(a, b)
    return _iou(a, b, near, np.ones(near.shape), np.ones(len(a)), np.ones(len(b)))


def iou_3d(a: Boxes, b: Boxes) -> Floats:
    """Intersection over union of the volumes of N and M upright boxes: float64 (N, M)."""
    bottom_a, bottom_b = (x.centers[:, 2] - x.sizes[:, 2] / 2 for x in (a, b))
    top_a, top_b = (x.centers[:, 2] + x.sizes[:, 2] / 2 for x in (a, b))
    shared = np.minimum(top_a[:, None], top_b) - np.maximum(bottom_a[:, None], bottom_b)
    near = _within_reach(a, b) & (shared > 0.0)
    return _iou(a, b, near, shared, a.sizes[:, 2], b.sizes[:, 2])


def iou_among(boxes: Boxes) -> Floats:
    """`iou_bev` of each of N boxes with those after it: float64 (N, N), else 0."""
    ones = np.ones(len(boxes))
    pairs = np.triu(_within_reach(boxes, boxes), 1)
    return _iou(boxes, boxes, pairs, np.ones(pairs.shape), ones, ones)


def _within_reach(a: Boxes, b: Boxes) -> NDArray[np.bool_]:
    """(N, M): which pairs are near enough to overlap."""
    apart = a.centers[:, None, :2] - b.centers[None, :, :2]
    reach = np.hypot(*a.sizes[:, :2].T)[:, None] + np.hypot(*b.sizes[:, :2].T)
    near: NDArray[np.bool_] = (apart**2).sum(axis=-1) <= (reach / 2) ** 2
    return near


def _iou(
    a: Boxes,
    b: Boxes,
    near: NDArray[np.bool_],
    shared_height: Floats,
    height_a: Floats,
    height_b: Floats,
) -> Floats:
    iou = np.zeros((len(a), len(b)))
    pairs = np.argwhere(near)
    corners_a, corners_b = footprints(a), footprints(b)
    volume_a = a.sizes[:, 0] * a.sizes[:, 1] * height_a
    volume_b = b.sizes[:, 0] * b.sizes[:, 1] * height_b
    for start in range(0, len(pairs), _PAIRS):
        rows, columns = pairs[start : start + _PAIRS].T
        overlap = _overlap_areas(corners_a[rows], corners_b[columns])
        overlap *= shared_height[rows, columns]
        union = volume_a[rows] + volume_b[columns] - overlap
        iou[rows, columns] = overlap / np.maximum(union, _EPSILON)
    return iou


def _overlap_areas(a: Floats, b: Floats) -> Floats:
    """Areas that P pairs of rectangles (P, 4, 2) share.

    The corners of the intersection are among the corners of one that lie in the other and the
    crossings of their edges: 24 candidates, sorted by angle about their mean.
    """
    crossings, crossed = _edge_crossings(a, b)
    points = np.concatenate([a, b, crossings], axis=1)
    valid = np.concatenate([_inside(a, b), _inside(b, a), crossed], axis=1)
    count = np.maximum(valid.sum(axis=1), 1)
    middle = (points * valid[..., None]).sum(axis=1) / count[:, None]
    offset = points - middle[:, None]
    angle = np.where(valid, np.arctan2(offset[..., 1], offset[..., 0]), np.inf)
    order = np.argsort(angle, axis=1)
    # Invalid candidates come last; a copy of the first valid point closes the polygon for them.
    ordered = np.take_along_axis(offset, order[..., None], axis=1)
    ordered_valid = np.take_along_axis(valid, order, axis=1)
    ordered = np.where(ordered_valid[..., None], ordered, ordered[:, :1])
    x, y = ordered[..., 0], ordered[..., 1]
    doubled = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    return np.where(valid.sum(axis=1) >= 3, np.abs(doubled) / 2, 0.0)


def _inside(corners: Floats, rectangles: Floats) -> NDArray[np.bool_]:
    """(P, 4): which corners lie in the rectangle of their pair, border included."""
    origin = rectangles[:, :1]
    along, across = rectangles[:, 1] - rectangles[:, 0], rectangles[:, 3] - rectangles[:, 0]
    offset = corners - origin
    inside = np.ones(corners.shape[:2], dtype=np.bool_)
    for edge in (along, across):
        projected = (offset * edge[:, None]).sum(axis=-1)
        length = (edge**2).sum(axis=-1)[:, None]
        slack = _EPSILON * np.maximum(length, 1.0)
        inside &= (projected >= -slack) & (projected <= length + slack)
    return inside


def _edge_crossings(a: Floats, b: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Crossings of the 4 x 4 edges of each pair: points (P, 16, 2) and whether they exist."""
    start_a, start_b = a[:, :, None], b[:, None, :]
    edge_a = np.roll(a, -1, axis=1)[:, :, None] - start_a
    edge_b = np.roll(b, -1, axis=1)[:, None, :] - start_b
    between = start_b - start_a
    turn = _cross(edge_a, edge_b)
    safe = np.where(np.abs(turn) > _EPSILON, turn, 1.0)
    along_a, along_b = _cross(between, edge_b) / safe, _cross(between, edge_a) / safe
    crossed = (np.abs(turn) > _EPSILON) & (along_a >= 0) & (along_a <= 1)
    crossed &= (along_b >= 0) & (along_b <= 1)
    points = start_a + along_a[..., None] * edge_a
    return points.reshape(len(a), 16, 2), crossed.reshape(len(a), 16)


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def nms(boxes: Boxes, max_iou: float = 0.1) -> Boxes:
    """Keeps the best-scored box of every group that overlaps by more than `max_iou` in BEV."""
    order = np.argsort(-boxes.scores, kind="stable")
    ranked = boxes.take(order)
    iou = iou_among(ranked)
    alive = np.ones(len(ranked), dtype=np.bool_)
    for i in range(len(ranked)):
        if alive[i]:
            alive[i + 1 :] &= iou[i, i + 1 :] <= max_iou
    return ranked.take(alive)


def weighted_fusion(boxes: Boxes, min_iou: float = 0.15, *, independent: bool = True) -> Boxes:
    """Merges boxes that overlap by at least `min_iou` in BEV into their weighted mean.

    After "Weighted boxes fusion" (Solovyev et al., 2021): groups form around the best-scored box;
    centres and sizes are averaged with weights that grow with the scores (SHARPNESS), headings
    modulo pi, since a rectangle looks the same turned by half. The label is the best box's.
    Independent witnesses raise the score: 1 - product of (1 - score); where they are not, the best
    score stays.
    """
    ranked = boxes.take(np.argsort(-boxes.scores, kind="stable"))
    iou = iou_among(ranked)
    free = np.ones(len(ranked), dtype=np.bool_)
    groups = []
    for i in range(len(ranked)):
        if free[i]:
            members = np.flatnonzero(free & ((iou[i] >= min_iou) | (np.arange(len(ranked)) == i)))
            free[members] = False
            groups.append(members)
    return Boxes.concatenate([_merge(ranked.take(members), independent) for members in groups])


def _merge(group: Boxes, independent: bool) -> Boxes:
    best_score = group.scores.max(initial=_EPSILON)
    weights = np.maximum(group.scores / best_score, _EPSILON) ** SHARPNESS
    weights = weights / weights.sum()
    best = group.headings[0]
    doubled = 2.0 * (group.headings - best)
    turn = np.arctan2((weights * np.sin(doubled)).sum(), (weights * np.cos(doubled)).sum()) / 2.0
    score = 1.0 - np.prod(1.0 - group.scores) if independent else group.scores.max()
    return Boxes(
        centers=(weights @ group.centers)[None],
        sizes=(weights @ group.sizes)[None],
        headings=np.array([wrap_heading(float(best + turn))]),
        scores=np.array([score]),
        labels=group.labels[:1],
    )
