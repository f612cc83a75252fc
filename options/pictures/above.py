"""Clouds and boxes from above, in the ego's frame, ahead to the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from options.pictures.picture import Dots, Filled, Layer, Lines, Picture, Rings, Words
from perception.boxes import footprints
from perception.scene import ground_mask
from perception.types import Boxes
from swarm.geometry import Matrix, Points, transform

PIXELS = 2400
"""Along the longer side."""
MAX_POINTS = 12_000
"""Of the picture; more are thinned evenly."""
TRUE, FOUND, EGO = "#2a9d3a", "#d62828", "#1d3557"
OTHERS = ("#c47f00", "#7b4b94", "#00798c", "#a23b72", "#5c6b2f")
"""Of the senders' points, in turn."""


@dataclass(frozen=True, slots=True)
class Outlines:
    """Boxes in the ego's frame, with their ink."""

    boxes: Boxes
    color: str
    width: float


Said = tuple[str, str]
"""A part of the text below a picture, and its colour; none for plain text."""


def above_ground(points: Points, ego_from_sensor: Matrix | None = None) -> Points:
    """Those of a scan, float32 (N, 3) in its sensor's frame, that are not ground: in the ego's
    frame, or the sensor's own where that is not said where it is."""
    if len(points):
        points = points[~ground_mask(points)]
    return points if ego_from_sensor is None else transform(ego_from_sensor, points)


def area_said(what: str, half_m: tuple[float, float]) -> Said:
    """What is shown, and of how large an area."""
    return (f"{what}{2 * half_m[0]:g} x {2 * half_m[1]:g} m; ", "")


def points_said(clouds: int) -> list[Said]:
    """Whose points are shown."""
    others: list[Said] = [(" and of the others", "")] if clouds > 1 else []
    return [("points of the ego", EGO), *others]


def from_above(
    half_m: tuple[float, float],
    clouds: Sequence[Points],
    outlines: Sequence[Outlines],
    words: Sequence[Said],
    sensors: Sequence[tuple[float, float]] = (),
) -> Picture:
    """A picture of the area within `half_m` of the ego along its x and y.

    Clouds, float32 (N, 3) in the ego's frame, have a colour each, the ego's first; of boxes each
    has a line from its middle to its front; `sensors` are the senders' places, drawn as rings; the
    ego is a triangle. `words` are parts of the text below, with a colour each.
    """
    half = np.array(half_m, dtype=np.float64)
    scale = PIXELS / (2 * half.max())
    layers: list[Layer] = []
    inside = [cloud[(np.abs(cloud[:, :2]) < half).all(axis=1), :2] for cloud in clouds]
    every = max(1, -(-sum(map(len, inside)) // MAX_POINTS))
    colors = (EGO, *(OTHERS[i % len(OTHERS)] for i in range(len(inside) - 1)))
    for cloud, color in zip(inside, colors[: len(inside)], strict=True):
        places = np.rint(cloud[::every] * scale * [1, -1]).astype(np.int64)
        layers.append(Dots(np.unique(places, axis=0), color))
    if sensors:
        layers.append(Rings(np.array(sensors) * scale * [1, -1], 14, OTHERS[0], 6))
    layers += [_lines(one, scale) for one in outlines]
    layers.append(Filled(np.array([[24.0, 0.0], [-18.0, 14.0], [-18.0, -14.0]]), EGO))
    wide, high = (round(2 * side * scale) for side in half.tolist())
    return Picture(wide, high, layers, Words(tuple(words)))


def _lines(outlines: Outlines, scale: float) -> Lines:
    boxes = outlines.boxes
    corners = footprints(boxes) * scale * [1, -1]
    middles = boxes.centers[:, :2] * scale * [1, -1]
    fronts = (corners[:, 0] + corners[:, 3]) / 2
    to_front = np.stack([middles, fronts], axis=1)
    return Lines(tuple(corners), tuple(to_front), outlines.color, outlines.width)
