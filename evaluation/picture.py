"""Draws one fused frame from above as SVG: points, true boxes, detected boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluation.cooperative import EVALUATION_RANGES_M, Disturbance, fuse_frame, judge
from perception.boxes import footprints
from perception.fusion.base import Fusion
from perception.scene import ground_mask
from perception.types import Boxes
from swarm.geometry import Matrix, Points, invert, transform
from worlds.base import World

PIXELS = 2400
"""Along the longer side."""
MIN_SCORE = 0.3
MAX_POINTS = 12_000
"""Of the picture; more are thinned evenly."""
TRUE, FOUND, EGO = "#2a9d3a", "#d62828", "#1d3557"
OTHERS = ("#c47f00", "#7b4b94", "#00798c", "#a23b72", "#5c6b2f")
"""Of the senders' points, in turn."""


def draw(
    world: World,
    frame: int,
    ego: str,
    participants: Sequence[str],
    algorithm: str | Fusion,
    disturbance: Disturbance | None = None,
) -> str:
    """An SVG document of the area in which boxes count, in the ego's frame, ahead to the right.

    The ego as a triangle; points without ground, a colour a robot; the true boxes that count and,
    over them, the boxes found with a score of MIN_SCORE at least, each with a line from its middle
    to its front. Raises as `fuse_frame` does.
    """
    fused = fuse_frame(world, frame, ego, participants, algorithm, disturbance)
    found, truth = judge(world, frame, ego, fused.boxes)
    found = found.take(found.scores >= MIN_SCORE)
    own_from_world = invert(world.pose(ego, frame).matrix())
    half_x, half_y = EVALUATION_RANGES_M[world.detector]
    scale = PIXELS / (2 * half_x)
    half = np.array([half_x, half_y])
    senders = list(fused.bytes)
    clouds = [_cloud(world, frame, robot, own_from_world, half) for robot in (ego, *senders)]
    every = max(1, -(-sum(map(len, clouds)) // MAX_POINTS))
    colors = (EGO, *(OTHERS[i % len(OTHERS)] for i in range(len(senders))))
    parts = [
        _dots(cloud[::every, :2] * scale, color)
        for cloud, color in zip(clouds, colors, strict=True)
    ]
    for boxes, color, width in ((truth, TRUE, 10), (found, FOUND, 4)):
        parts.append(_outlines(boxes.transformed(own_from_world), scale, color, width))
    parts.append(f'<path d="M24 0L-18 14L-18 -14z" fill="{EGO}"/>')
    wide, high = PIXELS, round(2 * half_y * scale)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" '
        f'viewBox="{-wide / 2:g} {-high / 2:g} {wide} {high + 60}">'
    )
    back = (
        f'<rect x="{-wide / 2:g}" y="{-high / 2:g}" width="{wide}" height="{high + 60}" '
        f'fill="white"/>'
    )
    line = (
        f'<text x="{-wide / 2 + 12:g}" y="{high / 2 + 42:g}" font-size="32">'
        f"{len(senders) + 1} robots, {2 * half_x:g} x {2 * half_y:g} m; "
        f'<tspan fill="{EGO}">points of the ego</tspan> and of the others; '
        f'<tspan fill="{TRUE}">{len(truth)} true boxes</tspan>, '
        f'<tspan fill="{FOUND}">{len(found)} found</tspan></text>'
    )
    return "\n".join([head, back, *parts, line, "</svg>\n"])


def _cloud(
    world: World, frame: int, robot: str, own_from_world: Matrix, half: NDArray[np.float64]
) -> Points:
    """Points in the ego's frame, inside the picture and above the ground."""
    scan = world.scan(robot, frame)
    points = scan.points[~ground_mask(scan.points)]
    here = transform(own_from_world @ scan.pose.matrix(), points)
    return here[(np.abs(here[:, :2]) < half).all(axis=1)]


def _dots(pixels: NDArray[np.floating], color: str) -> str:
    """One path of small dots; a pixel holds one dot."""
    places = np.unique(np.rint(pixels * [1, -1]).astype(int), axis=0)
    steps = np.diff(places, axis=0, prepend=np.zeros((1, 2), int))
    path = "".join(f"m{x} {y}h0" for x, y in steps.tolist())
    return (
        f'<path d="{path}" fill="none" stroke="{color}" stroke-width="4" '
        f'stroke-linecap="round" opacity="0.5"/>'
    )


def _outlines(boxes: Boxes, scale: float, color: str, width: int) -> str:
    path = ""
    middles = boxes.centers[:, :2] * scale * [1, -1]
    for corners, middle in zip(footprints(boxes) * scale * [1, -1], middles, strict=True):
        path += "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + "z"
        x, y = (corners[0] + corners[3]) / 2
        path += f"M{middle[0]:.1f} {middle[1]:.1f}L{x:.1f} {y:.1f}"
    return f'<path d="{path}" fill="none" stroke="{color}" stroke-width="{width}"/>'
