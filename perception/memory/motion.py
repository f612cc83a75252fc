"""How remembered objects move: a bank of filters, each with two models, still and moving.

Interacting multiple models after Blom and Bar-Shalom, "The interacting multiple model algorithm for
systems with Markovian switching coefficients" (1988), as in Bar-Shalom, Li and Kirubarajan (2001),
11.6.6; the moving model is of nearly constant velocity (white noise acceleration, 6.2.2), which
turns with the object. x and y are alike and independent, so one covariance serves both.

Where only a part of an object is seen, the middle of what is seen lies beside the object's: by an
offset that lasts while it is seen from the same side. It is a state of the filter, as biases of
sensors are (Friedland, "Treatment of bias in recursive filtering", 1969): so views of a part tell
how an object moves on, and hardly where it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STAYS_S = 30.0
"""How long an object stays still, or on the move, on average."""
WANDER_M2_S = 1e-4
"""Of a still object: what its place strays, as its box is seen from other sides."""
CHANGES_HZ = 0.1
"""Spectral density of a moving object's acceleration, by the square of the usual speed: what drives
fast brakes hard."""
OFFSET_S = 1.0
"""In this time an offset loses two thirds."""
STILL, MOVING = 0, 1


class Motions:
    """Place and velocity in the ground plane of N objects, at one time."""

    def __init__(self, usual_speed_m_s: float) -> None:
        """`usual_speed_m_s`: standard deviation of an object's velocity along an axis."""
        self._usual = usual_speed_m_s
        # By object, model, (place, velocity, offset): the axis, or the covariance's other index.
        self._mean = np.zeros((0, 2, 3, 2))
        self._spread = np.zeros((0, 2, 3, 3))
        self._offset = np.zeros(0)
        """Standard deviation of each object's offset along an axis, as long as it is not known."""
        self._weight = np.zeros((0, 2))
        """Chance of each model."""

    def __len__(self) -> int:
        return len(self._mean)

    def add(self, places: Floats, sds: Floats, offset_sds: Floats) -> None:
        """Objects seen for the first time at (K, 2) metres, with standard deviations (K,) along an
        axis, and those of the offset of a view of a part (K,)."""
        many = len(places)
        mean = np.zeros((many, 2, 3, 2))
        mean[:, :, 0] = places[:, None]
        spread = np.zeros((many, 2, 3, 3))
        spread[:, :, 0, 0] = sds[:, None] ** 2
        spread[:, MOVING, 1, 1] = self._usual**2
        spread[:, :, 2, 2] = offset_sds[:, None] ** 2
        self._offset = np.append(self._offset, offset_sds)
        self._mean = np.concatenate([self._mean, mean])
        self._spread = np.concatenate([self._spread, spread])
        self._weight = np.concatenate([self._weight, np.full((many, 2), 0.5)])

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Keeps these objects, in this order."""
        self._mean, self._spread = self._mean[rows], self._spread[rows]
        self._weight, self._offset = self._weight[rows], self._offset[rows]

    def predict(self, dt_s: float, turn_rates: Floats) -> None:
        """Moves all by a time that is not negative, while they turn by (N,) rad/s."""
        stay = 0.5 + 0.5 * np.exp(-2.0 * dt_s / STAYS_S)
        switch = np.array([[stay, 1.0 - stay], [1.0 - stay, stay]])
        # Mixing: what each model starts from.
        joint = self._weight[:, :, None] * switch
        weight = joint.sum(axis=1)
        share = joint / weight[:, None]
        mean = np.einsum("nij,niab->njab", share, self._mean)
        apart = self._mean[:, :, None] - mean[:, None]
        outer = np.einsum("nijax,nijbx->nijab", apart, apart) / 2.0
        spread = np.einsum("nij,nijab->njab", share, self._spread[:, :, None] + outer)
        # The way leads along the mean of the headings that it begins and ends with.
        velocity = mean[:, MOVING, 1]
        mean[:, MOVING, 0] += dt_s * _turned(velocity, turn_rates * dt_s / 2.0)
        mean[:, MOVING, 1] = _turned(velocity, turn_rates * dt_s)
        left = np.exp(-dt_s / OFFSET_S)
        mean[:, STILL, 1] = 0.0
        mean[:, :, 2] *= left
        step = np.zeros((2, 3, 3))
        step[:, 0, 0], step[:, 2, 2] = 1.0, left
        step[MOVING, 0, 1], step[MOVING, 1, 1] = dt_s, 1.0
        self._mean = mean
        self._spread = np.einsum("jab,njbc,jdc->njad", step, spread, step)
        self._spread[:, STILL, 0, 0] += WANDER_M2_S * dt_s
        self._spread[:, MOVING, :2, :2] += (
            CHANGES_HZ
            * self._usual**2
            * np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
        )
        self._spread[:, :, 2, 2] += self._offset[:, None] ** 2 * (1.0 - left**2)
        self._weight = weight

    def lose_offsets(self, rows: NDArray[np.intp]) -> None:
        """Of these objects another part is seen now."""
        self._mean[rows, :, 2] = 0.0
        self._spread[rows, :, 2] = 0.0
        self._spread[rows, :, :, 2] = 0.0
        self._spread[rows, :, 2, 2] = self._offset[rows, None] ** 2

    def update(
        self, rows: NDArray[np.intp], places: Floats, sds: Floats, partial: NDArray[np.bool_]
    ) -> None:
        """Objects `rows` were seen at (K, 2), with standard deviations (K,) along an axis, of some
        only a part (K,)."""
        mean, spread, seen = self._mean[rows], self._spread[rows], _seen(partial)
        cross = np.einsum("kjab,kb->kja", spread, seen)
        variance = np.einsum("kja,ka->kj", cross, seen) + sds[:, None] ** 2
        off = places[:, None] - np.einsum("kjax,ka->kjx", mean, seen)
        gain = cross / variance[:, :, None]
        self._mean[rows] = mean + gain[..., None] * off[:, :, None]
        self._spread[rows] = spread - gain[..., None] * cross[:, :, None]
        # Two axes: the density's factor counts twice.
        log = -np.log(variance) - (off**2).sum(axis=2) / (2.0 * variance)
        likelihood = np.exp(log - log.max(axis=1, keepdims=True))
        weight = self._weight[rows] * np.maximum(likelihood, 1e-9)
        self._weight[rows] = weight / weight.sum(axis=1, keepdims=True)

    def places(self) -> Floats:
        """(N, 2) metres."""
        there: Floats = np.einsum("nj,njx->nx", self._weight, self._mean[:, :, 0])
        return there

    def velocities(self) -> Floats:
        """(N, 2) m/s."""
        speed: Floats = np.einsum("nj,njx->nx", self._weight, self._mean[:, :, 1])
        return speed

    def moving(self) -> Floats:
        """(N,): the chance that each moves."""
        chance: Floats = self._weight[:, MOVING]
        return chance

    def sds(self) -> Floats:
        """(N,): standard deviation of the place along an axis, metres."""
        sd: Floats = np.sqrt((self._weight * self._variances()).sum(axis=1))
        return sd

    def apart(self, places: Floats, sds: Floats, partial: NDArray[np.bool_]) -> Floats:
        """(N, K): squared distances, in variances, of places (K, 2) with standard deviations (K,)
        along an axis from what the nearer model of each object expects; where a part of the object
        (N,) would be seen."""
        seen = _seen(partial)
        variance = np.einsum("njab,na,nb->nj", self._spread, seen, seen)[:, :, None] + sds**2
        off = places - np.einsum("njax,na->njx", self._mean, seen)[:, :, None]
        nearest: Floats = ((off**2).sum(axis=3) / variance).min(axis=1)
        return nearest

    def near(self, reaches: Floats) -> Floats:
        """(N,): the chance that each is within so many metres (N,) of `places`."""
        within = 1.0 - np.exp(-(reaches[:, None] ** 2) / (2.0 * self._variances()))
        chance: Floats = (self._weight * within).sum(axis=1)
        return chance

    def _variances(self) -> Floats:
        """(N, 2): by model, of the place around `places`, along an axis."""
        apart = self._mean[:, :, 0] - self.places()[:, None]
        variance: Floats = self._spread[:, :, 0, 0] + (apart**2).sum(axis=2) / 2.0
        return variance


def _seen(partial: NDArray[np.bool_]) -> Floats:
    """(K, 3): what of place, velocity and offset is seen."""
    return np.column_stack([np.ones(len(partial)), np.zeros(len(partial)), partial])


def _turned(vectors: Floats, angles: Floats) -> Floats:
    """Vectors (N, 2), each by its angle (N,), counterclockwise."""
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = vectors.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])
