"""`detect`: clusters of a scan or of several merged scans, as scored and labelled boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.boxes import nms
from perception.detector.config import DetectorConfig, ObjectClass
from perception.detector.rectangles import Rectangles, fit
from perception.scene import segment
from perception.scene.fast import GROUND_BAND_M
from perception.scene.segmentation import Groups, Segmentation
from perception.types import Boxes
from swarm.geometry import Points

Floats = NDArray[np.float64]
MIN_SCORE = 0.05
MAX_BOXES = 1000
"""Best boxes that are compared with each other: noise for a cloud must not cost gigabytes."""
SIZE_SPREAD = 0.3
"""Standard deviation of the logarithm of a class's sizes: 1.35 times the usual is one sigma off."""


def detect(points: Points, config: DetectorConfig, origins: Floats | None = None) -> Boxes:
    """Oriented boxes of the objects in a cloud.

    Args:
        points: float32 (N, 3), metres, z up; NaN and infinite points are left out.
        config: classes to look for.
        origins: float64 (S, 3), the sensors that the points come from, in the frame of the
            points; one at the origin when None. A partly seen object grows away from the
            nearest sensor to its class's usual size.

    Returns boxes in the frame of the points, best score first. The score tells how much a cluster
    looks like its class: number of points, and how far it had to be completed.
    """
    found = segment(points, "fast")
    if not found.count:
        return Boxes.empty()
    origins = np.zeros((1, 3)) if origins is None else origins
    xy = found.points[found.members, :2]
    rectangles = fit(xy, found.labels, found.count)
    bottom, height, counts = _heights(found)
    centers, sizes, headings = _shape(rectangles)
    usable = counts >= config.min_points
    usable &= np.hypot(*centers.T) > config.own_body_m
    parts = []
    for label in config.classes:
        fits = usable & _plausible(sizes, height, label)
        usable &= ~fits
        index = np.flatnonzero(fits)
        if len(index):
            parts.append(
                _complete(
                    centers[index],
                    sizes[index],
                    headings[index],
                    bottom[index],
                    height[index],
                    counts[index] / config.sure_points,
                    label,
                    config.size_slack_m,
                    origins,
                )
            )
    boxes = Boxes.concatenate(parts)
    best = np.argsort(-boxes.scores, kind="stable")[:MAX_BOXES]
    return nms(boxes.take(best[boxes.scores[best] >= MIN_SCORE]))


def _heights(found: Segmentation) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Ground height under each cluster, its height above it, and its number of points."""
    groups = Groups.of(found.labels, found.count)
    z = found.points[found.members, 2]
    low, high = groups.minimum(z).astype(np.float64), groups.maximum(z).astype(np.float64)
    bottom = low - GROUND_BAND_M
    return bottom, high - bottom, np.diff(groups.starts, append=len(z))


def _shape(rectangles: Rectangles) -> tuple[Floats, Floats, Floats]:
    """Centres (N, 2), length and width (N, 2) with length >= width, headings (N,)."""
    size = rectangles.high - rectangles.low
    middle = (rectangles.high + rectangles.low) / 2
    cos, sin = np.cos(rectangles.headings), np.sin(rectangles.headings)
    centers = np.stack(
        [cos * middle[:, 0] - sin * middle[:, 1], sin * middle[:, 0] + cos * middle[:, 1]], axis=1
    )
    turned = size[:, 1] > size[:, 0]
    headings = rectangles.headings + np.where(turned, np.pi / 2, 0.0)
    return centers, np.where(turned[:, None], size[:, ::-1], size), headings


def _plausible(sizes: Floats, height: Floats, label: ObjectClass) -> NDArray[np.bool_]:
    fits: NDArray[np.bool_] = sizes[:, 0] <= label.max_size[0]
    fits &= sizes[:, 1] <= label.max_size[1]
    fits &= (height <= label.max_size[2]) & (height >= label.min_height)
    fits &= sizes[:, 0] >= label.min_length
    return fits


def _complete(
    centers: Floats,
    sizes: Floats,
    headings: Floats,
    bottom: Floats,
    height: Floats,
    evidence: Floats,
    label: ObjectClass,
    slack_m: float,
    origins: Floats,
) -> Boxes:
    """Boxes of clusters of one class, grown to the class's usual size."""
    length, width, tall = label.size
    # A side no longer than a usual width is an end: what is seen is the front or the back.
    end_seen = sizes[:, 0] <= width * 1.15
    headings = np.where(end_seen, headings + np.pi / 2, headings)
    seen = np.where(end_seen[:, None], sizes[:, ::-1], sizes)
    usual = np.array([length, width])
    full = np.where(seen <= usual + slack_m, usual, seen)
    axes = np.stack(
        [
            np.stack([np.cos(headings), np.sin(headings)], axis=1),
            np.stack([-np.sin(headings), np.cos(headings)], axis=1),
        ],
        axis=1,
    )
    away = centers[:, None] - origins[None, :, :2]
    nearest = np.linalg.norm(away, axis=2).argmin(axis=1)
    away = away[np.arange(len(centers)), nearest]
    side = np.einsum("nij,nj->ni", axes, away)
    # Sides seen nearly edge-on grow both ways.
    lean = np.clip(side / np.maximum(np.linalg.norm(away, axis=1), 1e-6)[:, None] / 0.25, -1.0, 1.0)
    shift = lean * np.maximum(full - seen, 0.0) / 2
    centers = centers + np.einsum("nij,ni->nj", axes, shift)
    tall_full = np.where(height <= tall + slack_m, tall, height)
    completeness = np.minimum(seen / full, 1.0).mean(axis=1)
    # Few objects are much larger than their class usually is; bushes and walls are any size.
    excess = np.log(np.column_stack([full, tall_full]) / np.array(label.size))
    usual_size = np.exp(-0.5 * ((excess / SIZE_SPREAD) ** 2).sum(axis=1))
    scores = np.minimum(1.0, evidence) * (0.3 + 0.7 * completeness) * usual_size
    return Boxes(
        centers=np.column_stack([centers, bottom + tall_full / 2]),
        sizes=np.column_stack([full, tall_full]),
        headings=np.mod(headings, 2 * np.pi),
        scores=np.clip(scores, 0.0, 1.0),
        labels=(label.label,) * len(centers),
    )
