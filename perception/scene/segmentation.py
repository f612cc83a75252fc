"""What a method of the Scene Abstraction Module finds in a scan, and sums over its groups."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from swarm.geometry import Points

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Segmentation:
    """Which points of a scan are ground and which belong to which object.

    points float32 (M, 3): the points that the method used; ground bool (M,);
    members intp (K,): positions in `points` of the points that belong to an object;
    labels int32 (K,): the object of each member, 0 to count - 1, each used at least once.
    Points that are neither ground nor member are noise or out of the method's reach.
    """

    points: Points
    ground: NDArray[np.bool_]
    members: NDArray[np.intp]
    labels: NDArray[np.int32]
    count: int

    @classmethod
    def empty(cls) -> Segmentation:
        """Of a cloud without points."""
        return cls(
            np.zeros((0, 3), np.float32),
            np.zeros(0, np.bool_),
            np.zeros(0, np.intp),
            np.zeros(0, np.int32),
            0,
        )


@dataclass(frozen=True, slots=True)
class Groups:
    """Values sorted by group, so that `ufunc.reduceat` works on one group after the other.

    Sorting 16-bit keys is a radix sort: with it a minimum by group costs a tenth of
    `np.minimum.at`, whose loop has no fast path for float32.
    """

    order: NDArray[np.intp]
    """Positions of the values, group by group, in their old order inside a group."""
    starts: NDArray[np.intp]
    """Where each group that is not empty begins in `order`."""
    keys: NDArray[np.intp]
    """The groups that are not empty, ascending."""

    @classmethod
    def of(cls, keys: NDArray[np.integer], count: int) -> Groups:
        """Groups of values with the given keys, each in 0 to count - 1."""
        narrow = keys.astype(np.uint16 if count <= 1 << 16 else np.int64)
        sizes = np.bincount(keys, minlength=count)
        used = np.flatnonzero(sizes)
        ends = np.cumsum(sizes[used])
        return cls(np.argsort(narrow, kind="stable"), ends - sizes[used], used)

    def minimum(self, values: NDArray[Scalar]) -> NDArray[Scalar]:
        """The least value of each group in `keys`."""
        lowest: NDArray[Scalar] = np.minimum.reduceat(values[self.order], self.starts)
        return lowest

    def maximum(self, values: NDArray[Scalar]) -> NDArray[Scalar]:
        """The greatest value of each group in `keys`."""
        highest: NDArray[Scalar] = np.maximum.reduceat(values[self.order], self.starts)
        return highest
