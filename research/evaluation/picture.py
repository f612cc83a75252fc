"""Draws one fused frame of a world from above: points, true boxes, detected boxes."""

from __future__ import annotations

from collections.abc import Sequence

from options.pictures.above import (
    EGO,
    FOUND,
    TRUE,
    Outlines,
    above_ground,
    area_said,
    from_above,
    points_said,
)
from options.pictures.picture import Picture
from perception.fusion.base import Fusion
from swarm.geometry import Matrix, Points, invert
from worlds.base import World
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import EVALUATION_RANGES_M, judge


def draw(
    world: World,
    frame: int,
    ego: str,
    participants: Sequence[str],
    algorithm: str | Fusion,
    disturbance: Disturbance | None = None,
    *,
    only_found: bool = False,
) -> Picture:
    """The area in which boxes count, in the ego's frame, ahead to the right.

    The ego as a triangle; points without ground, a colour a robot; the true boxes that count and,
    over them, the published boxes. `only_found` shows nothing of the recording itself: the boxes
    found and, in place of points and true boxes, those that the ego finds alone. Raises as
    `fuse_frame` does.
    """
    fused = fuse_frame(world, frame, ego, participants, algorithm, disturbance)
    found, truth = judge(world, frame, ego, fused.boxes)
    own_from_world = invert(world.pose(ego, frame).matrix())
    half = EVALUATION_RANGES_M[world.detector]
    senders = list(fused.bytes)
    words = [area_said(f"{len(senders) + 1} robots, ", half)]
    clouds: list[Points] = []
    sensors: list[tuple[float, float]] = []
    if only_found:
        alone = fuse_frame(world, frame, ego, (), SINGLE).boxes
        under, color = judge(world, frame, ego, alone)[0], EGO
        sensors = [_sensor(world, frame, robot, own_from_world) for robot in senders]
        words += [(f"{len(under)} boxes found alone", EGO), (", ", "")]
        found_words = f"{len(found)} together"
    else:
        under, color = truth, TRUE
        scans = [world.scan(robot, frame) for robot in (ego, *senders)]
        clouds = [above_ground(one.points, own_from_world @ one.pose.matrix()) for one in scans]
        words += [*points_said(len(clouds)), ("; ", "")]
        known = len(world.ground_truth(frame).boxes) > 0
        true_words = f"{len(truth)} true boxes" if known else "true boxes not known"
        words += [(true_words, TRUE), (", ", "")]
        found_words = f"{len(found)} found"
    outlines = [
        Outlines(under.transformed(own_from_world), color, 10),
        Outlines(found.transformed(own_from_world), FOUND, 4),
    ]
    return from_above(half, clouds, outlines, [*words, (found_words, FOUND)], sensors)


def _sensor(world: World, frame: int, robot: str, own_from_world: Matrix) -> tuple[float, float]:
    x, y = (own_from_world @ world.pose(robot, frame).matrix())[:2, 3].tolist()
    return x, y
