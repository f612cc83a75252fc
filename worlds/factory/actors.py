"""What moves on the floor, and its shape: upright boxes that turn with the actor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes
from swarm.body import Body
from swarm.geometry import wrap_heading
from worlds.factory.paths import Motion, Path

Floats = NDArray[np.float64]

STATIC = -1
"""Index of everything that is no actor."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A class of actor. Parts are (forward, left, bottom, length, width, height), metres."""

    label: str
    size: tuple[float, float, float]
    """Length, width, height of the box around all parts."""
    parts: tuple[tuple[float, float, float, float, float, float], ...]


SENSOR_HEIGHT_M = 1.2
ROBOT = Shape(
    "robot",
    (0.9, 0.6, 1.26),
    (
        (0.0, 0.0, 0.0, 0.9, 0.6, 0.4),
        (0.0, 0.0, 0.4, 0.06, 0.06, 0.74),
        (0.0, 0.0, 1.14, 0.12, 0.12, 0.12),
    ),
)
"""A flat carrier; its LiDAR stands in the middle on a mast."""
ROBOT_BODY = Body(
    label=ROBOT.label, size=ROBOT.size, center=(0.0, 0.0, ROBOT.size[2] / 2 - SENSOR_HEIGHT_M)
)
FORKLIFT = Shape("forklift", (2.5, 1.2, 2.1), ((0.0, 0.0, 0.0, 2.5, 1.2, 2.1),))
WORKER = Shape("person", (0.5, 0.5, 1.75), ((0.0, 0.0, 0.0, 0.5, 0.5, 1.75),))


@dataclass(frozen=True, slots=True)
class Actor:
    """One thing that moves, or could."""

    identity: str
    shape: Shape
    path: Path


@dataclass(frozen=True, slots=True)
class Solids:
    """The parts of all actors at one moment, in the world frame."""

    owner: NDArray[np.int16]
    """(P,): index of the actor that each part belongs to."""
    centers: Floats
    """(P, 3), metres."""
    halves: Floats
    """(P, 3): half the length, width, height."""
    headings: Floats
    """(P,), radians."""


def solids(actors: tuple[Actor, ...], motions: list[Motion]) -> Solids:
    """The parts of actors in these motions."""
    owner, centers, halves, headings = [], [], [], []
    for index, (actor, motion) in enumerate(zip(actors, motions, strict=True)):
        cos, sin = math.cos(motion.heading), math.sin(motion.heading)
        for forward, left, bottom, length, width, height in actor.shape.parts:
            owner.append(index)
            centers.append(
                (
                    motion.x + cos * forward - sin * left,
                    motion.y + sin * forward + cos * left,
                    bottom + height / 2,
                )
            )
            halves.append((length / 2, width / 2, height / 2))
            headings.append(motion.heading)
    return Solids(
        np.array(owner, dtype=np.int16),
        np.array(centers, dtype=np.float64),
        np.array(halves, dtype=np.float64),
        np.array(headings, dtype=np.float64),
    )


def true_boxes(actors: tuple[Actor, ...], motions: list[Motion]) -> Boxes:
    """One box around each actor, in the world frame, score 1."""
    return Boxes(
        centers=np.array(
            [(m.x, m.y, a.shape.size[2] / 2) for a, m in zip(actors, motions, strict=True)]
        ),
        sizes=np.array([a.shape.size for a in actors], dtype=np.float64),
        headings=np.array([wrap_heading(m.heading) for m in motions]),
        scores=np.ones(len(actors)),
        labels=tuple(a.shape.label for a in actors),
    )
