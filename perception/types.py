"""What perception takes and gives: clouds, objects, boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm.errors import ScanError
from swarm.geometry import Matrix, Points, transform, wrap_heading, yaw_of


@dataclass(frozen=True, slots=True, repr=False)
class SceneObject:
    """One object of a scene description, in the frame of the points it was made from."""

    centroid: tuple[float, float, float]
    """Mean of the object's points, metres."""
    distance: float
    """From the sensor to the centroid, metres."""
    size: tuple[float, float, float]
    """Axis-aligned extent along x, y, z, metres."""
    points: int
    density: float
    """Points per cubic metre of the axis-aligned box."""

    def __repr__(self) -> str:
        at, size = (" ".join(f"{v:.2f}" for v in row) for row in (self.centroid, self.size))
        return (
            f"SceneObject(at {at} m, {self.distance:.1f} m away, {size} m large, "
            f"{self.points} points)"
        )


@dataclass(frozen=True, slots=True, repr=False)
class Scene:
    """A structured description of one scan (Scene Abstraction Module)."""

    objects: tuple[SceneObject, ...]
    ground_points: int

    def __repr__(self) -> str:
        nearest = min((one.distance for one in self.objects), default=None)
        near = "" if nearest is None else f", the nearest {nearest:.1f} m away"
        return f"Scene({len(self.objects)} objects{near}; {self.ground_points} ground points)"


@dataclass(frozen=True, slots=True, repr=False)
class Boxes:
    """N oriented boxes in one frame.

    centers float64 (N, 3) metres, the middle of the box; sizes float64 (N, 3) length, width,
    height in metres; headings float64 (N,) radians in [0, 2 pi); scores float64 (N,) in [0, 1];
    labels: N names.
    """

    centers: NDArray[np.float64]
    sizes: NDArray[np.float64]
    headings: NDArray[np.float64]
    scores: NDArray[np.float64]
    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.headings)

    def __repr__(self) -> str:
        kinds = []
        for label in dict.fromkeys(self.labels):
            scores = [self.scores[i] for i, other in enumerate(self.labels) if other == label]
            low, high = f"{min(scores):.2f}", f"{max(scores):.2f}"
            kinds.append(f"{len(scores)} {label} {low}" + (f" to {high}" if high != low else ""))
        return f"Boxes({len(self)}{': ' if kinds else ''}{', '.join(kinds)})"

    @classmethod
    def empty(cls) -> Boxes:
        """No boxes."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), ())

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Boxes:
        """The boxes at the given positions, or where the mask holds."""
        picked = np.arange(len(self))[index]
        return Boxes(
            self.centers[picked],
            self.sizes[picked],
            self.headings[picked],
            self.scores[picked],
            tuple(self.labels[i] for i in picked),
        )

    def above(self, score: float) -> Boxes:
        """The boxes with at least this score.

        >>> both = Boxes(np.zeros((2, 3)), np.ones((2, 3)), np.zeros(2), np.array([0.9, 0.2]),
        ...              ("person", "robot"))
        >>> both, both.above(0.5)
        (Boxes(2: 1 person 0.90, 1 robot 0.20), Boxes(1: 1 person 0.90))
        """
        return self.take(self.scores >= score)

    def transformed(self, a_from_b: Matrix) -> Boxes:
        """Boxes given in b, in a. Roll and pitch of the transform move the centres only."""
        centers = self.centers @ a_from_b[:3, :3].T + a_from_b[:3, 3]
        turn = yaw_of(a_from_b)
        headings = np.array([wrap_heading(h + turn) for h in self.headings], dtype=np.float64)
        return Boxes(centers, self.sizes, headings, self.scores, self.labels)

    @staticmethod
    def concatenate(parts: list[Boxes]) -> Boxes:
        """All boxes of all parts, in order."""
        if not parts:
            return Boxes.empty()
        return Boxes(
            np.concatenate([p.centers for p in parts]),
            np.concatenate([p.sizes for p in parts]),
            np.concatenate([p.headings for p in parts]),
            np.concatenate([p.scores for p in parts]),
            tuple(label for p in parts for label in p.labels),
        )


def clean_points(points: NDArray[np.floating]) -> Points:
    """The finite points of a cloud as float32 (N, 3); sensors mark missing returns with NaN.

    Raises ScanError when the array is not (N, 3).
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise ScanError(f"a cloud must have shape (N, 3), this one has {points.shape}")
    cloud = np.asarray(points, dtype=np.float32)
    finite = np.isfinite(cloud)
    if finite.all():
        return cloud
    return cloud.compress(finite[:, 0] & finite[:, 1] & finite[:, 2], axis=0)


__all__ = ["Boxes", "Points", "Scene", "SceneObject", "clean_points", "transform"]
