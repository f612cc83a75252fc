"""How remembered objects move: a bank of filters, each with two models, still and moving.

Interacting multiple models after Blom and Bar-Shalom, "The interacting multiple model algorithm for
systems with Markovian switching coefficients" (1988), as in Bar-Shalom, Li and Kirubarajan (2001),
11.6.6; the moving model is of nearly constant velocity (white noise acceleration, 6.2.2). x and y
are alike and independent, so one covariance serves both.
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
STILL, MOVING = 0, 1


class Motions:
    """Place and velocity in the ground plane of N objects, at one time."""

    def __init__(self, usual_speed_m_s: float) -> None:
        """`usual_speed_m_s`: standard deviation of an object's velocity along an axis."""
        self._usual = usual_speed_m_s
        # By object, model, (place, velocity): the axis, or the covariance's other index.
        self._mean = np.zeros((0, 2, 2, 2))
        self._spread = np.zeros((0, 2, 2, 2))
        self._weight = np.zeros((0, 2))
        """Chance of each model."""

    def __len__(self) -> int:
        return len(self._mean)

    def add(self, places: Floats, sds: Floats) -> None:
        """Objects seen for the first time at (K, 2) metres, with standard deviations (K,)."""
        many = len(places)
        mean = np.zeros((many, 2, 2, 2))
        mean[:, :, 0] = places[:, None]
        spread = np.zeros((many, 2, 2, 2))
        spread[:, :, 0, 0] = sds[:, None] ** 2
        spread[:, MOVING, 1, 1] = self._usual**2
        self._mean = np.concatenate([self._mean, mean])
        self._spread = np.concatenate([self._spread, spread])
        self._weight = np.concatenate([self._weight, np.full((many, 2), 0.5)])

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Keeps these objects, in this order."""
        self._mean, self._spread = self._mean[rows], self._spread[rows]
        self._weight = self._weight[rows]

    def predict(self, dt_s: float) -> None:
        """Moves all by a time that is not negative."""
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
        step = np.array([[[1.0, 0.0], [0.0, 0.0]], [[1.0, dt_s], [0.0, 1.0]]])
        noise = np.zeros((2, 2, 2))
        noise[STILL, 0, 0] = WANDER_M2_S * dt_s
        noise[MOVING] = (
            CHANGES_HZ
            * self._usual**2
            * np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
        )
        self._mean = np.einsum("jab,njbx->njax", step, mean)
        self._spread = np.einsum("jab,njbc,jdc->njad", step, spread, step) + noise
        self._weight = weight

    def update(self, rows: NDArray[np.intp], places: Floats, sds: Floats) -> None:
        """Objects `rows` were seen at (K, 2), with standard deviations (K,) along an axis."""
        mean, spread = self._mean[rows], self._spread[rows]
        variance = spread[:, :, 0, 0] + sds[:, None] ** 2
        off = places[:, None] - mean[:, :, 0]
        gain = spread[:, :, :, 0] / variance[:, :, None]
        self._mean[rows] = mean + gain[..., None] * off[:, :, None]
        self._spread[rows] = spread - gain[..., None] * spread[:, :, :1]
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

    def sds(self) -> Floats:
        """(N,): standard deviation of the place along an axis, metres."""
        sd: Floats = np.sqrt((self._weight * self._variances()).sum(axis=1))
        return sd

    def apart(self, places: Floats, sds: Floats) -> Floats:
        """(N, K): squared distances, in variances, of places (K, 2) with standard deviations (K,)
        along an axis from what the nearer model of each object expects."""
        variance = self._spread[:, :, 0, 0, None] + sds**2
        off = places - self._mean[:, :, None, 0]
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
