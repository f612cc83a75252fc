"""Draws one fused frame from above as SVG: points, true boxes, detected boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from perception.boxes import footprints
from perception.fusion.base import Fusion
from perception.scene import ground_mask
from perception.types import Boxes
from swarm.geometry import Matrix, Points, invert, transform
from worlds.base import World
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import EVALUATION_RANGES_M, judge

PIXELS = 2400
"""Along the longer side."""
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
    *,
    only_found: bool = False,
) -> str:
    """An SVG document of the area in which boxes count, in the ego's frame, ahead to the right.

    The ego as a triangle; points without ground, a colour a robot; the true boxes that count and,
    over them, the published boxes, each with a line from its middle to its
    front. `only_found` shows nothing of the recording itself: the boxes found and, in place
    of points and true boxes, those that the ego finds alone. Raises as `fuse_frame` does.
    """
    fused = fuse_frame(world, frame, ego, participants, algorithm, disturbance)
    found, truth = judge(world, frame, ego, fused.boxes)
    own_from_world = invert(world.pose(ego, frame).matrix())
    half_x, half_y = EVALUATION_RANGES_M[world.detector]
    scale = PIXELS / (2 * half_x)
    senders = list(fused.bytes)
    words = f"{len(senders) + 1} robots, {2 * half_x:g} x {2 * half_y:g} m; "
    if only_found:
        alone = fuse_frame(world, frame, ego, (), SINGLE).boxes
        under, color = judge(world, frame, ego, alone)[0], EGO
        parts = [_robots(world, frame, senders, own_from_world, scale)]
        words += f'<tspan fill="{EGO}">{len(under)} boxes found alone</tspan>, '
        found_words = f"{len(found)} together"
    else:
        under, color = truth, TRUE
        parts = _clouds(world, frame, (ego, *senders), own_from_world, scale)
        words += (
            f'<tspan fill="{EGO}">points of the ego</tspan> and of the others; '
            f'<tspan fill="{TRUE}">{len(truth)} true boxes</tspan>, '
        )
        found_words = f"{len(found)} found"
    for boxes, ink, width in ((under, color, 10), (found, FOUND, 4)):
        parts.append(_outlines(boxes.transformed(own_from_world), scale, ink, width))
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
        f'<text x="{-wide / 2 + 12:g}" y="{high / 2 + 42:g}" font-size="32">{words}'
        f'<tspan fill="{FOUND}">{found_words}</tspan></text>'
    )
    return "\n".join([head, back, *parts, line, "</svg>\n"])


def _clouds(
    world: World, frame: int, robots: Sequence[str], own_from_world: Matrix, scale: float
) -> list[str]:
    """The points of all robots, the ego first, a colour each."""
    half = np.array(EVALUATION_RANGES_M[world.detector])
    clouds = [_cloud(world, frame, robot, own_from_world, half) for robot in robots]
    every = max(1, -(-sum(map(len, clouds)) // MAX_POINTS))
    colors = (EGO, *(OTHERS[i % len(OTHERS)] for i in range(len(robots) - 1)))
    return [
        _dots(cloud[::every, :2] * scale, color)
        for cloud, color in zip(clouds, colors, strict=True)
    ]


def _robots(
    world: World, frame: int, robots: Sequence[str], own_from_world: Matrix, scale: float
) -> str:
    """Where the senders' sensors are: rings."""
    path = ""
    for robot in robots:
        x, y = (own_from_world @ world.pose(robot, frame).matrix())[:2, 3] * scale * [1, -1]
        path += f"M{x - 14:.1f} {y:.1f}a14 14 0 1 0 28 0a14 14 0 1 0 -28 0z"
    return f'<path d="{path}" fill="none" stroke="{OTHERS[0]}" stroke-width="6"/>'


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
