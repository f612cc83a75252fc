"""How fast fused objects move: one Kalman filter of constant velocity for each.

State and noise after Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and
Navigation" (2001), 6.3.2: piecewise constant acceleration. x and y are alike and independent, so
one covariance serves both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes

Floats = NDArray[np.float64]

MEASURED_M = 0.08
"""Standard deviation of a fused box's middle, an axis."""
ACCELERATION_M_S2 = 1.0
GATE = 9.2
"""Squared distance, in variances, beyond which a box is not a track's: 99 % of two axes."""
FORGOTTEN_S = 1.0
"""A track that was not seen for so long ends."""
MIN_SCORE = 0.3
"""Of a box that is followed: less sure ones come and go."""
MAX_FOLLOWED = 200
"""Boxes of one time that are followed, the best: finding the tracks of all takes every pair."""


@dataclass(slots=True)
class _Track:
    label: str
    place: Floats
    velocity: Floats
    spread: Floats
    """(2, 2): covariance of place and velocity along one axis."""
    seen_s: float

    def at(self, time_s: float) -> tuple[Floats, Floats]:
        """Place and spread at another time, before or after."""
        dt = time_s - self.seen_s
        step = np.array([[1.0, dt], [0.0, 1.0]])
        push = np.array([dt * dt / 2.0, dt]) * ACCELERATION_M_S2
        return self.place + dt * self.velocity, step @ self.spread @ step.T + np.outer(push, push)

    def measured(self, place: Floats, time_s: float) -> None:
        here, spread = self.at(time_s)
        gain = spread[:, 0] / (spread[0, 0] + MEASURED_M**2)
        off = place - here
        self.place = here + gain[0] * off
        self.velocity = self.velocity + gain[1] * off
        self.spread = spread - np.outer(gain, spread[0])
        self.seen_s = time_s


class Tracks:
    """The objects of late, in the world frame. Times are seconds of one clock."""

    def __init__(self, usual_speed_m_s: float) -> None:
        """`usual_speed_m_s`: standard deviation of an object's velocity along an axis."""
        self._usual = usual_speed_m_s
        self._tracks: list[_Track] = []

    def clear(self) -> None:
        """Forgets everything."""
        self._tracks.clear()

    def update(self, boxes: Boxes, time_s: float) -> Floats:
        """Takes up the boxes of a time; returns the velocity of each, (N, 2) m/s in the world
        frame, 0 where it is not known. A track that was seen later learns nothing from them."""
        self._tracks = [t for t in self._tracks if time_s - t.seen_s <= FORGOTTEN_S]
        velocities = np.zeros((len(boxes), 2))
        best = np.argsort(-boxes.scores, kind="stable")[:MAX_FOLLOWED]
        followed = np.sort(best[boxes.scores[best] >= MIN_SCORE])
        matched = self._matched(boxes.take(followed), time_s)
        for number, i in enumerate(followed):
            track = matched.get(number)
            if track is None:
                spread = np.diag([MEASURED_M**2, self._usual**2])
                place = boxes.centers[i, :2].copy()
                self._tracks.append(_Track(boxes.labels[i], place, np.zeros(2), spread, time_s))
                continue
            if time_s > track.seen_s:
                track.measured(boxes.centers[i, :2], time_s)
            velocities[i] = track.velocity
        return velocities

    def _matched(self, boxes: Boxes, time_s: float) -> dict[int, _Track]:
        """The track of each box that has one: together as near as can be."""
        from scipy.optimize import linear_sum_assignment

        tracks = self._tracks
        if not tracks or not len(boxes):
            return {}
        there = [track.at(time_s) for track in tracks]
        places = np.stack([place for place, _ in there])
        spread = np.array([spread[0, 0] for _, spread in there]) + MEASURED_M**2
        apart = ((boxes.centers[:, None, :2] - places[None]) ** 2).sum(axis=2) / spread
        other = np.array(boxes.labels)[:, None] != np.array([track.label for track in tracks])
        # No match costs as much as the worst one: more would shuffle sure matches to get another.
        cost = np.where(other, GATE, np.minimum(apart, GATE))
        rows, columns = linear_sum_assignment(cost)
        return {
            int(row): tracks[column]
            for row, column in zip(rows, columns, strict=True)
            if cost[row, column] < GATE
        }
