"""What a growing set of robots shows together, in expectation: each arrives, or not, on its own.

Of the ground, a cell counts with the probability that anyone who sees it arrives; of objects, the
best evidence that arrives is expected. Both are expectations of coverage functions over independent
arrivals, so they stay monotone and submodular, and where all arrive for certain they are coverage
itself, to the bit.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.model import Weights

LEVELS = 10
"""Steps of evidence in which robots that may not arrive are counted."""


COARSE_LEVELS = 5
"""The same where many options of each robot are weighed."""


class Views:
    """What each robot of a scene sees; row 0 is the ego."""

    def __init__(
        self,
        areas: NDArray[np.bool_],
        evidence: NDArray[np.float64],
        area_weight: float,
        object_weight: float,
        weights: Weights | None = None,
    ) -> None:
        """`areas` (n, G, G), `evidence` (n, K) in [0, 1]; the weights of a cell and of an object
        in the share of all that is seen; `weights`: by how much that differs between them."""
        self._weights = weights
        self._words: NDArray[np.float64] | None = None
        """(W,) what each cell of a word counts; None: all alike."""
        if weights is None:
            self.bits = pack_areas(areas)
            """(n, W) words of 64 cells, so that a union of 20,000 cells takes microseconds."""
        else:
            self.bits, self._words = pack_weighted(areas, weights.cells)
        self.evidence = evidence
        self.area_weight = area_weight
        self.object_weight = object_weight
        self._areas = areas

    def counted(self, bits: NDArray[np.uint64]) -> NDArray[np.float64]:
        """What the cells of packed rows (..., W) count, float64 (...)."""
        ones = np.bitwise_count(bits)
        if self._words is None:
            return np.asarray(ones.sum(axis=-1, dtype=np.int64), dtype=np.float64)
        return np.asarray(ones @ self._words, dtype=np.float64)

    def summed(self, objects: NDArray[np.float64]) -> NDArray[np.float64]:
        """What objects (..., K) count together, float64 (...)."""
        if self._weights is None:
            return np.asarray(objects.sum(axis=-1), dtype=np.float64)
        return np.asarray(objects @ self._weights.objects, dtype=np.float64)

    @cached_property
    def cell_weights(self) -> NDArray[np.float32] | None:
        """(C,) what each of `cells` counts; None: all alike."""
        return None if self._weights is None else self._weights.cells.ravel()[self._open]

    @cached_property
    def _open(self) -> NDArray[np.bool_]:
        flat = self._areas.reshape(len(self._areas), -1)
        seen: NDArray[np.bool_] = flat.any(axis=0) & ~flat[0]
        return seen

    @cached_property
    def cells(self) -> NDArray[np.float32]:
        """(n, C): 1 where a robot sees a cell, of those that some robot sees and the ego does not.
        Needed only where somebody may not arrive."""
        return self._areas.reshape(len(self._areas), -1)[:, self._open].astype(np.float32)

    @cached_property
    def patterns(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What the robots but the ego show that it does not, as columns that several share:
        (n - 1, C) how much of each a robot shows, in [0, 1], and (C,) its weight in the share of
        all that is seen. Cells that the same robots see are one column; objects have one for each
        step of evidence that the ego's leaves open."""
        weigh = self._weights
        cells, count = _merged(
            self._areas[1:] & ~self._areas[0], None if weigh is None else weigh.cells
        )
        own = self.evidence[0]
        steps = np.arange(COARSE_LEVELS)[:, None] / COARSE_LEVELS
        low, high = np.maximum(steps, own), np.maximum(steps + 1.0 / COARSE_LEVELS, own)
        reached = np.clip(self.evidence[1:, None, :], low, high) - low
        open_ = (reached > 0.0).any(axis=0)
        reached, length = reached[:, open_], (high - low)[open_]
        seen = np.concatenate([cells, reached / length], axis=1).astype(np.float32)
        if weigh is not None:
            length = length * np.broadcast_to(weigh.objects, open_.shape)[open_]
        weights = [self.area_weight * count, self.object_weight * length]
        return seen, np.concatenate(weights).astype(np.float32)

    @cached_property
    def alone(self) -> NDArray[np.float64]:
        """(n,): what each robot adds to the ego's share, alone and for certain."""
        rows = np.arange(len(self.evidence))
        return Union(self).gains(rows, np.ones(len(rows)))

    @cached_property
    def level(self) -> NDArray[np.intp]:
        """(n, K): the step of LEVELS that each evidence lies in."""
        steps: NDArray[np.intp] = np.minimum(self.evidence * LEVELS, LEVELS - 1).astype(np.intp)
        return steps

    @cached_property
    def beyond(self) -> NDArray[np.float64]:
        """(n, K): how far each evidence reaches into its step."""
        over: NDArray[np.float64] = self.evidence - self.level / LEVELS
        return over


class Union:
    """The ego and those who were added, each with the probability that it arrives."""

    def __init__(self, views: Views, first: int = 0) -> None:
        """`first`: the row to begin with. Only to the ego's can others be added that may not
        arrive."""
        self._views = views
        self._first = first
        self._bits = views.bits[first]
        self._evidence = views.evidence[first]
        """The best of those who arrive for certain."""
        self._sure: list[int] = []
        self._missed: NDArray[np.float32] | None = None
        """(C,) probability that nobody who sees a cell arrives; None while all arrive for
        certain."""
        self._above: NDArray[np.float64] = np.zeros(0)
        """(LEVELS, K) probability that the best evidence that arrives lies below each step."""

    def gains(self, rows: NDArray[np.intp], arrival: NDArray[np.float64]) -> NDArray[np.float64]:
        """What each of the rows adds to the share of all that is seen, float64 (rows,);
        `arrival`: with which probability each arrives."""
        views = self._views
        if self._missed is None:
            cells = views.counted(views.bits[rows] & ~self._bits)
            objects = views.summed(np.maximum(views.evidence[rows] - self._evidence, 0.0))
        else:
            missed = self._missed
            if views.cell_weights is not None:
                missed = missed * views.cell_weights
            cells = (views.cells[rows] @ missed).astype(np.float64)
            objects = self._expected_above(rows)
        added: NDArray[np.float64] = views.area_weight * cells + views.object_weight * objects
        return arrival * added

    def add(self, row: int, arrival: float) -> None:
        """Takes a robot in."""
        views = self._views
        if arrival < 1.0 and self._missed is None:
            self._missed = np.ones(views.cells.shape[1], dtype=np.float32)
            for sure in self._sure:
                self._missed *= 1.0 - views.cells[sure]
            self._above = np.ones((LEVELS, views.evidence.shape[1]))
        if self._missed is not None:
            self._missed *= 1.0 - arrival * views.cells[row]
        if arrival >= 1.0:
            self._sure.append(row)
            self._bits = self._bits | views.bits[row]
            self._evidence = np.maximum(self._evidence, views.evidence[row])
        else:
            steps = np.arange(LEVELS)[:, None]
            reach = np.clip(views.evidence[row] * LEVELS - steps, 0.0, 1.0)
            self._above *= 1.0 - arrival * reach

    def share(self) -> float:
        """The part of all that is seen that they show; a rounding error may lead above 1."""
        views = self._views
        if self._missed is None:
            cells = float(views.counted(self._bits))
            objects = float(views.summed(self._evidence))
        else:
            cells = float(views.counted(views.bits[self._first]))
            shown = 1.0 - self._missed
            if views.cell_weights is not None:
                shown = shown * views.cell_weights
            cells += float(shown.sum(dtype=np.float64))
            below, floor = self._below()
            objects = float(views.summed(1.0 - (below[LEVELS] - floor)))
        return views.area_weight * cells + views.object_weight * objects

    def _expected_above(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Sum over objects of E[max(0, e - best evidence that arrives)]: the integral of the
        probability that the best lies below, from the best certain one to e."""
        views = self._views
        below, floor = self._below()
        objects = np.arange(views.evidence.shape[1])
        level, beyond = views.level[rows], views.beyond[rows]
        risen = below[level, objects] + self._above[level, objects] * beyond - floor
        return views.summed(np.maximum(risen, 0.0))

    def _below(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The integral of that probability from 0 to each step, (LEVELS + 1, K), and to the best
        certain evidence, (K,)."""
        below = np.zeros((LEVELS + 1, self._views.evidence.shape[1]))
        np.cumsum(self._above / LEVELS, axis=0, out=below[1:])
        objects = np.arange(below.shape[1])
        at = np.minimum(self._evidence * LEVELS, LEVELS - 1).astype(np.intp)
        floor: NDArray[np.float64] = below[at, objects] + self._above[at, objects] * (
            self._evidence - at / LEVELS
        )
        return below, floor


def _merged(
    areas: NDArray[np.bool_], weights: NDArray[np.float32] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cells that somebody sees, those that the same robots see as one: (n, C) whether each robot
    does, and (C,) what they count together; `weights` (G, G), None where all count 1."""
    flat = areas.reshape(len(areas), math.prod(areas.shape[1:]))
    seen = flat.any(axis=0)
    flat = flat[:, seen]
    who = np.packbits(flat, axis=0).T
    padded = np.ascontiguousarray(np.pad(who, ((0, 0), (0, -who.shape[1] % 8)))).view(np.uint64)
    keys = padded[:, 0] if padded.shape[1] == 1 else padded
    axis = None if keys.ndim == 1 else 0  # of numbers it is faster than of rows
    _, first, group, count = np.unique(
        keys, axis=axis, return_index=True, return_inverse=True, return_counts=True
    )
    counted: NDArray[np.float64] = count.astype(np.float64)
    if weights is not None:
        counted = np.bincount(group.ravel(), weights.ravel()[seen], len(first)).astype(np.float64)
    return flat[:, first].astype(np.float64), counted


def pack_areas(areas: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Area masks, bool (n, G, G), as rows of 64-bit words."""
    packed = np.packbits(areas.reshape(len(areas), -1), axis=1)
    padding = -packed.shape[1] % 8
    return np.ascontiguousarray(np.pad(packed, ((0, 0), (0, padding)))).view(np.uint64)


def pack_weighted(
    areas: NDArray[np.bool_], weights: NDArray[np.float32]
) -> tuple[NDArray[np.uint64], NDArray[np.float64]]:
    """Area masks, bool (n, G, G), as words (n, W) of cells that weigh the same, by weights (G, G);
    and what a cell of each word counts, (W,)."""
    flat, weigh = areas.reshape(len(areas), -1), weights.ravel()
    levels = np.unique(weigh)
    packed = [pack_areas(flat[:, weigh == level]) for level in levels]
    words = [np.full(part.shape[1], level) for part, level in zip(packed, levels, strict=True)]
    return np.concatenate(packed, axis=1), np.concatenate(words).astype(np.float64)
