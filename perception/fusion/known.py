"""Robots whose beacons tell where they are: known, so never detected.

A sensor sees little of what carries it, while its pose and its body come with every beacon, whether
the robot takes part in the fusion or not. What is fused is therefore searched for these bodies, and
what shows one of them is no detection.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.boxes import iou_bev
from perception.types import Boxes
from swarm.body import Body
from swarm.geometry import Matrix

SAME_OBJECT_IOU = 0.1
"""Two solid bodies do not overlap: a box that shares this much with a known robot shows it."""
NEAR_M = 0.5
"""A box of the robot's own class with its middle this near shows it, too: poses are off, and half a
body is seen."""
MANOEUVRE_M_S = 1.0
"""How fast a robot strays from the straight line that its beacon's velocity makes, on average."""


@dataclass(frozen=True, slots=True)
class KnownRobot:
    """One robot at the time of a frame, in one frame of reference."""

    robot: str
    body: Body
    here_from_sensor: Matrix
    age_s: float = 0.0
    """Since the pose that it told, which was brought to the frame's time by its velocity."""
    velocity: tuple[float, float] = (0.0, 0.0)
    """Along the world's x and y, m/s, as it tells."""

    def box(self) -> Boxes:
        """Its body, one box of score 1."""
        box = Boxes(
            centers=np.array([self.body.center], dtype=np.float64),
            sizes=np.array([self.body.size], dtype=np.float64),
            headings=np.zeros(1),
            scores=np.ones(1),
            labels=(self.body.label,),
        )
        return box.transformed(self.here_from_sensor)


def seen_at(
    known: Sequence[KnownRobot], corrections: Mapping[str, Matrix]
) -> tuple[KnownRobot, ...]:
    """The robots where what they see shows them: moved by their corrections, 4 x 4 in the frame of
    reference. Those without one stay where their beacons say that they are."""
    return tuple(
        replace(one, here_from_sensor=corrections[one.robot] @ one.here_from_sensor)
        if one.robot in corrections
        else one
        for one in known
    )


def bodies(known: Sequence[KnownRobot]) -> Boxes:
    """One box of score 1 for each."""
    return Boxes.concatenate([one.box() for one in known])


def without_known(found: Boxes, known: Sequence[KnownRobot]) -> Boxes:
    """The fused boxes that do not show a known robot; both in the same frame of reference."""
    return found.take(np.flatnonzero(~shows_known(found, known)))


def shows_known(found: Boxes, known: Sequence[KnownRobot]) -> NDArray[np.bool_]:
    """Which boxes (N,) show a known robot; both in the same frame of reference."""
    if not known or not len(found):
        return np.zeros(len(found), dtype=np.bool_)
    told = bodies(known)
    apart = found.centers[:, None, :2] - told.centers[None, :, :2]
    reach = np.array([NEAR_M + MANOEUVRE_M_S * one.age_s for one in known])
    alike = np.array([[a == b for b in told.labels] for a in found.labels], dtype=np.bool_)
    shows = alike & (np.hypot(apart[..., 0], apart[..., 1]) <= reach)
    shows |= iou_bev(found, told) > SAME_OBJECT_IOU
    return np.asarray(shows.any(axis=1), dtype=np.bool_)


def without_own(
    found: Boxes, own_body_m: float, stood_at: tuple[float, float] = (0.0, 0.0)
) -> Boxes:
    """Boxes in the ego's frame without the ego, whom others see where it stood: it does not report
    itself."""
    return found.take(np.hypot(*(found.centers[:, :2] - stood_at).T) > own_body_m)
