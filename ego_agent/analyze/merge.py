"""Merging what several robots see of the same thing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

BLOCK_SHARE = 3
"""Blocks a merge distance: points in one block are merged at once, which bounds the pairs that
remain however many robots see the same object."""


SLACK = 1.001
"""A search tree rounds distances in its own way: it is asked for a little more, and what it finds
is measured."""


def are_near(
    xy: NDArray[np.float64], places: NDArray[np.float64], distance_m: float
) -> NDArray[np.bool_]:
    """Which of the points (N, 2) are no farther than that from one of the places (M, 2), which may
    be any finite ones: bool (N,)."""
    near = np.zeros(len(xy), dtype=np.bool_)
    if not len(xy):
        return near
    # A beacon may claim any finite place, whose square would not be finite.
    reach = SLACK * distance_m
    around = (places >= xy.min(axis=0) - reach) & (places <= xy.max(axis=0) + reach)
    places = places[around.all(axis=1)]
    if not len(places):
        return near
    found = cKDTree(xy).sparse_distance_matrix(cKDTree(places), reach, output_type="ndarray")
    point, place = found["i"], found["j"]
    gaps = xy[point] - places[place]
    near[point[(gaps**2).sum(axis=1) <= distance_m**2]] = True
    return near


def merge_nearby(
    xy: NDArray[np.float64], weight: NDArray[np.float64], distance_m: float
) -> NDArray[np.intp]:
    """Groups of points (N, 2): the group number of each, int (N,), from 0 without gaps.

    The heaviest point leads a group that takes all points within the distance; then the heaviest
    of the rest, and so on. Unlike single linkage this does not chain a row of shelves into one
    object. Points in one block of a third of the distance count as one with the sum of their
    weights, at their weighted mean. Weights must be positive.
    """
    if not len(xy):
        return np.zeros(0, dtype=np.intp)
    block = np.floor(xy / (distance_m / BLOCK_SHARE)).astype(np.int64)
    block -= block.min(axis=0)
    # One number a block, in the order of its row and then its column.
    numbers = block[:, 0] * (block[:, 1].max() + 1) + block[:, 1]
    _, member = np.unique(numbers, return_inverse=True)
    total = np.bincount(member, weight).astype(np.float64)
    middle = np.column_stack([np.bincount(member, weight * xy[:, i]) / total for i in range(2)])
    leader = _leaders(middle, total, distance_m)
    _, group = np.unique(leader, return_inverse=True)
    merged: NDArray[np.intp] = group.reshape(-1)[member].astype(np.intp)
    return merged


def _leaders(
    xy: NDArray[np.float64], weight: NDArray[np.float64], distance_m: float
) -> NDArray[np.intp]:
    """The index of each point's leader.

    All points that outweigh their undecided neighbours become leaders at once, round by round;
    the heaviest undecided point always does, so every round decides at least one.
    """
    rank = np.empty(len(xy), dtype=np.intp)
    rank[np.lexsort((xy[:, 1], xy[:, 0], -weight))] = np.arange(len(xy))
    pairs = cKDTree(xy).query_pairs(distance_m, output_type="ndarray")
    first_leads = rank[pairs[:, 0]] < rank[pairs[:, 1]]
    heavy = np.where(first_leads, pairs[:, 0], pairs[:, 1])
    light = np.where(first_leads, pairs[:, 1], pairs[:, 0])
    leader = np.full(len(xy), -1, dtype=np.intp)
    while (undecided := leader < 0).any():
        open_pairs = undecided[heavy] & undecided[light]
        heavy, light = heavy[open_pairs], light[open_pairs]
        leads = undecided.copy()
        leads[light] = False
        leader[leads] = np.flatnonzero(leads)
        taken = leads[heavy]
        best = np.full(len(xy), len(xy), dtype=np.intp)
        np.minimum.at(best, light[taken], rank[heavy[taken]])
        absorbed = best < len(xy)
        leader[absorbed] = np.argsort(rank)[best[absorbed]]
    return leader
