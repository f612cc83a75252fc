"""How remembered objects turn: one Kalman filter of heading and turn rate for each.

The turn rate is an Ornstein-Uhlenbeck process: what turns goes on turning for a while (as the
accelerations of Singer, "Estimating optimal tracking filter performance for manned maneuvering
targets", 1970). What is as long as it is wide (a person) turns on the spot, any time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TURNS_RAD_S, TURNS_FOR_S = 0.3, 1.0
"""Standard deviation of a turn rate, and the time in which it loses two thirds. Measured, as what
follows, on floors and streets of seeds from 1,920,000 on."""
WANDER_RAD2_S, SQUARE_WANDER_RAD2_S = 1e-3, 0.1
"""How a heading strays beside that; and a square's, whose turn rate is not followed."""


class Headings:
    """Heading and turn rate of N objects, at one time."""

    def __init__(self) -> None:
        self._mean = np.zeros((0, 2))
        self._spread = np.zeros((0, 2, 2))

    def add(self, headings: Floats, sds: Floats) -> None:
        """Objects seen for the first time: headings (K,), their standard deviations (K,), rad."""
        many = len(headings)
        spread = np.zeros((many, 2, 2))
        spread[:, 0, 0], spread[:, 1, 1] = sds**2, TURNS_RAD_S**2
        self._mean = np.concatenate([self._mean, np.column_stack([headings, np.zeros(many)])])
        self._spread = np.concatenate([self._spread, spread])

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Keeps these objects, in this order."""
        self._mean, self._spread = self._mean[rows], self._spread[rows]

    def predict(self, dt_s: float, square: NDArray[np.bool_]) -> None:
        """Turns all by a time that is not negative; `square` (N,): as long as wide."""
        left = np.exp(-dt_s / TURNS_FOR_S)
        step = np.array([[1.0, TURNS_FOR_S * (1.0 - left)], [0.0, left]])
        self._mean = self._mean @ step.T
        self._spread = np.einsum("ab,nbc,dc->nad", step, self._spread, step)
        self._spread[:, 0, 0] += dt_s * np.where(square, SQUARE_WANDER_RAD2_S, WANDER_RAD2_S)
        self._spread[:, 1, 1] += TURNS_RAD_S**2 * (1.0 - left**2)
        self._mean[square, 1] = 0.0
        self._spread[square, 1] = self._spread[square, :, 1] = 0.0

    def update(
        self, rows: NDArray[np.intp], headings: Floats, sds: Floats, square: NDArray[np.bool_]
    ) -> None:
        """Objects `rows` were seen with headings (K,), standard deviations (K,), rad; a rectangle
        looks the same after half a turn, a square (K,) after a quarter."""
        alike = np.where(square, 4.0, 2.0)
        off = alike * (headings - self._mean[rows, 0])
        off = np.arctan2(np.sin(off), np.cos(off)) / alike
        spread = self._spread[rows]
        gain = spread[:, :, 0] / (spread[:, 0, 0] + sds**2)[:, None]
        self._mean[rows] += gain * off[:, None]
        self._spread[rows] = spread - gain[:, :, None] * spread[:, None, 0]

    def headings(self) -> Floats:
        """(N,) rad, in [0, 2 pi)."""
        return self._mean[:, 0] % (2.0 * np.pi)

    def rates(self) -> Floats:
        """(N,) rad/s, counterclockwise."""
        return self._mean[:, 1]
