"""Transforms over time: how one frame moves in another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from options.ros.messages import Transform
from swarm.errors import WorldError
from swarm.geometry import Matrix

MAX_GAP_NS = 1_000_000_000
"""Farther from the nearest sample than this and than two of its usual steps, nothing is known."""
MOST = 1e7
"""Metres or m/s of anything on this planet; messages carry no more."""
_USUAL_STEPS = 2
_NEARLY_EQUAL = 0.9995
"""Cosine of half the angle above which the two ends of a turn are too near for the sine."""


def matrix_of(translation: NDArray[np.float64], rotation: NDArray[np.float64]) -> Matrix:
    """4x4 float64 from a translation (3,) and a unit quaternion x, y, z, w (4,)."""
    x, y, z, w = (float(value) for value in rotation)
    out = np.eye(4)
    out[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    out[:3, 3] = translation
    return out


def slerp(a: NDArray[np.float64], b: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The unit quaternion at `share` (0 to 1) of the shorter way from a to b (Shoemake, 1985)."""
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    if cosine > _NEARLY_EQUAL:
        mixed = a + share * (b - a)
        return np.asarray(mixed / np.linalg.norm(mixed))
    angle = np.arccos(cosine)
    weights = np.sin((1 - share) * angle), np.sin(share * angle)
    return np.asarray((weights[0] * a + weights[1] * b) / np.sin(angle))


@dataclass(frozen=True, slots=True)
class Placed:
    """A transform at a moment."""

    a_from_b: Matrix
    known: bool
    """False where no sample is near."""


class Track:
    """One frame in another, over time. A single sample holds at all times."""

    def __init__(self, samples: Sequence[Transform]) -> None:
        """Raises WorldError for a sample that is no transform."""
        values = np.array([(*one.translation, *one.rotation) for one in samples])
        with np.errstate(over="ignore", invalid="ignore"):
            lengths = np.linalg.norm(values[:, 3:], axis=1)
        right = (np.abs(values) <= MOST).all(axis=1) & (lengths > 0.9) & (lengths < 1.1)
        if not right.all():
            one = samples[int(right.argmin())]
            raise WorldError(
                f"{one.child!r} in {one.parent!r} is at {one.translation}, turned by "
                f"{one.rotation}: that is no place on this planet, or no unit quaternion"
            )
        # Of two samples with one stamp, the one recorded last holds.
        kept = dict(sorted(((one.stamp_ns, one) for one in samples), key=lambda item: item[0]))
        self.times_ns = np.fromiter(kept, dtype=np.int64, count=len(kept))
        self._translations = np.array([one.translation for one in kept.values()])
        rotations = np.array([one.rotation for one in kept.values()])
        self._rotations = rotations / np.linalg.norm(rotations, axis=1, keepdims=True)
        step = float(np.median(np.diff(self.times_ns))) if len(kept) > 1 else 0.0
        self._reach_ns = max(MAX_GAP_NS, _USUAL_STEPS * step)

    def at(self, time_ns: int) -> Placed:
        """Interpolated between samples; outside of them, the nearest."""
        after = int(np.searchsorted(self.times_ns, time_ns))
        last = len(self.times_ns) - 1
        if last == 0:
            return Placed(matrix_of(self._translations[0], self._rotations[0]), known=True)
        low, high = max(0, after - 1), min(after, last)
        begin, end = int(self.times_ns[low]), int(self.times_ns[high])
        share = (time_ns - begin) / (end - begin) if end > begin else 0.0
        # Written so that what stands still stays where it is, to the last bit.
        step = self._translations[high] - self._translations[low]
        translation = self._translations[low] + share * step
        rotation = slerp(self._rotations[low], self._rotations[high], share)
        nearest = min(abs(time_ns - begin), abs(time_ns - end))
        return Placed(matrix_of(translation, rotation), nearest <= self._reach_ns)
