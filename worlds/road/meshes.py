"""Triangle meshes from simple parts: boxes, lofts, sheets, tufts of leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm.geometry import Matrix

Floats = NDArray[np.float64]

_CORNERS = np.array(
    [[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], dtype=np.float64
)
_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mesh:
    """vertices float64 (N, 3), metres; triangles int64 (M, 3), indices of vertices."""

    vertices: Floats
    triangles: NDArray[np.int64]

    def moved(self, a_from_b: Matrix) -> Mesh:
        """The mesh, given in b, in a."""
        return Mesh(self.vertices @ a_from_b[:3, :3].T + a_from_b[:3, 3], self.triangles)


def join(parts: list[Mesh]) -> Mesh:
    """One mesh of all parts (at least one)."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([p.triangles + start for p, start in zip(parts, starts[:-1], strict=True)]),
    )


def boxes(centers: ArrayLike, sizes: ArrayLike, headings: ArrayLike) -> Mesh:
    """N upright boxes: middles (N, 3), length, width and height (N, 3), headings (N,)."""
    middle, size = np.reshape(centers, (-1, 3)), np.reshape(sizes, (-1, 3))
    heading = np.reshape(headings, (-1, 1))
    corner = _CORNERS[None] * size[:, None]
    cos, sin = np.cos(heading), np.sin(heading)
    x = cos * corner[..., 0] - sin * corner[..., 1]
    y = sin * corner[..., 0] + cos * corner[..., 1]
    vertices = np.stack([x, y, corner[..., 2]], axis=-1) + middle[:, None]
    triangles = _FACES[None] + 8 * np.arange(len(middle))[:, None, None]
    return Mesh(vertices.reshape(-1, 3), triangles.reshape(-1, 3))


def sheet(points: Floats) -> Mesh:
    """A surface through a grid of points (A, B, 3)."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    return Mesh(points.reshape(-1, 3), triangles)


def loft(sections: Floats) -> Mesh:
    """A closed body through convex outlines (S, P, 3), each with its points in the same order."""
    around = sheet(np.concatenate([sections, sections[:, :1]], axis=1))
    caps = []
    for outline in (sections[0], sections[-1]):
        fan = np.arange(1, len(outline) - 1)
        caps.append(Mesh(outline, np.stack([np.zeros_like(fan), fan, fan + 1], axis=-1)))
    return join([around, *caps])


def cylinder(base: ArrayLike, axis: ArrayLike, radius: float, top_radius: float) -> Mesh:
    """An eight-sided cylinder or cone from `base` along `axis`, both (3,)."""
    start, along = np.asarray(base, dtype=np.float64), np.asarray(axis, dtype=np.float64)
    helper = np.array([0.0, 1.0, 0.0]) if abs(along[2]) > abs(along[1]) else np.array([0, 0, 1.0])
    first = np.cross(along, helper)
    first /= np.linalg.norm(first)
    second = np.cross(along, first) / np.linalg.norm(along)
    turn = np.arange(8) * (np.pi / 4)
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    return loft(np.stack([start + radius * ring, start + along + top_radius * ring]))


def leaves(
    middle: ArrayLike, radii: ArrayLike, count: int, size: float, rng: np.random.Generator
) -> Mesh:
    """Loose triangles in an ellipsoid, denser towards its surface: a crown or a bush."""
    way = rng.standard_normal((count, 3))
    way *= (rng.random((count, 1)) ** 0.25) / np.linalg.norm(way, axis=1, keepdims=True)
    spots = np.asarray(middle) + way * np.asarray(radii)
    vertices = spots[:, None] + rng.normal(0.0, size, (count, 3, 3))
    return Mesh(vertices.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
