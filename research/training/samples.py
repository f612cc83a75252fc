"""One training sample: clouds in a reference frame, and the boxes that are to be found in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from perception.scene import ground_mask
from perception.types import Boxes
from swarm.geometry import Matrix, Points, Pose, invert, transform, wrap_heading
from worlds.base import Scan, World

MAX_SENDERS = 4
CODED_STEP_M = 0.115
"""Side of a cube whose corners are 0.1 m from its middle: coded points err no more by default."""
SHAKEN = 0.4
"""Share of the samples whose helpers' poses err by what correction leaves of odometry's errors."""
SHIFT_M, TURN_RAD = 0.12, np.radians(0.5)
"""Standard deviations of these errors at most."""


@dataclass(frozen=True, slots=True)
class Sample:
    """What the network is shown once."""

    clouds: tuple[Points, ...]
    """The ego's first; each float32 (N, 3) in the reference frame."""
    boxes: Boxes
    """Every object in the reference frame, the ego too, whom helpers may see."""
    hits: NDArray[np.int64]
    """(clouds, boxes): points of each cloud on each box."""


class ActorWorld(World, Protocol):
    """A world that also tells which actor each point lies on."""

    def scan_with_actors(self, robot: str, frame: int) -> tuple[Scan, NDArray[np.int16]]:
        """A scan and, for each point, the index of its actor in `ground_truth`, or -1."""
        ...

    def actors(self, frame: int) -> tuple[Boxes, tuple[str, ...]]:
        """Boxes and names of all actors, seen or not, in the order of their indices."""
        ...


Maker = Callable[[np.random.Generator], ActorWorld]


def draw(
    world: ActorWorld, rng: np.random.Generator, reach_m: float, aside_m: float = 0.0
) -> Sample:
    """A random frame, ego, helpers, reference frame and form of sharing.

    A third of the samples is one robot alone, a third merges the points of several as early fusion
    does, a third keeps their clouds apart. `reach_m`: how far helpers may be; `aside_m`: how
    far along x the middle of the reference frame may lie from the ego, mostly less.
    """
    frame = int(rng.integers(world.frame_count))
    ego = str(rng.choice(world.robots))
    near = world.pose(ego, frame)
    others = [
        robot
        for robot in world.robots
        if robot != ego and world.pose(robot, frame).distance_to(near) < reach_m
    ]
    form = rng.choice(["alone", "merged", "apart"]) if others else "alone"
    count = 0 if form == "alone" else int(rng.integers(1, min(len(others), MAX_SENDERS) + 1))
    helpers = [str(robot) for robot in rng.permutation(others)[:count]] if count else []
    reference = _reference(near, rng)
    if aside_m:
        reference[0, 3] += aside_m * float(rng.uniform(-1.0, 1.0, 2).mean())
    mirror = rng.random() < 0.5
    coded = form == "merged" and rng.random() < 0.7
    shake = float(rng.random()) if rng.random() < SHAKEN else 0.0

    truth, _ = world.actors(frame)
    clouds, hits = [], []
    for robot in (ego, *helpers):
        scan, actors = world.scan_with_actors(robot, frame)
        points, pose = scan.points, scan.pose
        if robot != ego and form == "merged":
            kept = ~ground_mask(points)
            points, actors = points[kept], actors[kept]
            if coded:
                points = np.rint(points / CODED_STEP_M).astype(np.float32) * CODED_STEP_M
        if robot != ego and shake:
            x, y, turn = shake * rng.normal(0.0, (SHIFT_M, SHIFT_M, TURN_RAD))
            pose = Pose(pose.x + x, pose.y + y, pose.z, pose.roll, pose.pitch, pose.yaw + turn)
        clouds.append(transform(reference @ pose.matrix(), points))
        hits.append(np.bincount(actors[actors >= 0], minlength=len(truth)))
    boxes = truth.transformed(reference)
    counts = np.stack(hits)
    if form == "merged":
        clouds, counts = [np.concatenate(clouds)], counts.sum(axis=0, keepdims=True)
    if mirror:
        clouds = [cloud * np.array([1, -1, 1], dtype=np.float32) for cloud in clouds]
        boxes = mirrored(boxes)
    return Sample(tuple(clouds), boxes, counts)


def mirrored(boxes: Boxes) -> Boxes:
    """The boxes with left and right exchanged."""
    return Boxes(
        boxes.centers * [1.0, -1.0, 1.0],
        boxes.sizes,
        np.array([wrap_heading(-float(heading)) for heading in boxes.headings]),
        boxes.scores,
        boxes.labels,
    )


def _reference(ego: Pose, rng: np.random.Generator) -> Matrix:
    """`reference_from_world`: the ego's own frame, in half of the draws turned at random."""
    turn = float(rng.uniform(-np.pi, np.pi)) if rng.random() < 0.5 else 0.0
    return invert(Pose(ego.x, ego.y, ego.z, ego.roll, ego.pitch, ego.yaw + turn).matrix())
