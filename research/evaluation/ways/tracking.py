"""How well objects are followed: MOTA, IDF1, identity switches, GOSPA."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Floats = NDArray[np.float64]

NEAR_M = 0.5
"""A track whose middle is this near a true object shows it."""
CUT_OFF_M = 1.0
"""GOSPA: what a missed or a false object costs is half of this, squared."""


@dataclass(slots=True)
class Following:
    """Counts over the frames of one drive, or of several.

    MOTA and identity switches after Bernardin and Stiefelhagen, "Evaluating multiple object
    tracking performance: the CLEAR MOT metrics" (2008); IDF1 after Ristani et al. (2016); GOSPA
    after Rahmathullah, Garcia-Fernandez and Svensson (2017), with p = 2 and alpha = 2.
    """

    truths: int = 0
    missed: int = 0
    false: int = 0
    switches: int = 0
    gospa: list[float] = field(default_factory=list)
    _held: dict[str, int] = field(default_factory=dict)
    """The track that showed each object last."""
    _together: Counter[tuple[str, int]] = field(default_factory=Counter)
    _told: Counter[int] = field(default_factory=Counter)
    _there: Counter[str] = field(default_factory=Counter)

    def add(
        self, places: Floats, tracks: NDArray[np.int64], true_places: Floats, names: tuple[str, ...]
    ) -> None:
        """One frame: middles (N, 2) of what is told and their tracks (N,), and of what is true."""
        self._told.update(tracks.tolist())
        self._there.update(names)
        apart = np.hypot(*(true_places[:, None] - places[None]).transpose(2, 0, 1))
        # Who showed an object before goes on to, where it is still near.
        cost = np.minimum(apart, 2.0 * NEAR_M)
        for i, name in enumerate(names):
            cost[i] -= 2.0 * NEAR_M * ((tracks == self._held.get(name)) & (apart[i] <= NEAR_M))
        rows, columns = linear_sum_assignment(cost)
        near = apart[rows, columns] <= NEAR_M
        for i, j in zip(rows[near], columns[near], strict=True):
            name, track = names[i], int(tracks[j])
            self.switches += name in self._held and self._held[name] != track
            self._held[name] = track
            self._together[name, track] += 1
        shown = int(near.sum())
        self.truths += len(names)
        self.missed += len(names) - shown
        self.false += len(tracks) - shown
        self.gospa.append(_gospa(apart))

    def figures(self, rate_hz: float) -> dict[str, Any]:
        """What was counted, of frames at this rate."""
        minutes = self.truths / rate_hz / 60.0
        return {
            "mota": 1.0 - (self.missed + self.false + self.switches) / max(1, self.truths),
            "idf1": self._idf1(),
            "identity_switches_per_track_minute": self.switches / max(minutes, 1e-9),
            "gospa_m": float(np.mean(self.gospa)) if self.gospa else math.nan,
        }

    def take_up(self, other: Following, drive: int) -> None:
        """Adds another drive, whose objects and tracks are others."""
        self.truths += other.truths
        self.missed += other.missed
        self.false += other.false
        self.switches += other.switches
        self.gospa += other.gospa
        shift = drive * 1_000_000
        for (name, track), count in other._together.items():
            self._together[f"{drive} {name}", track + shift] += count
        for track, count in other._told.items():
            self._told[track + shift] += count
        for name, count in other._there.items():
            self._there[f"{drive} {name}"] += count

    def _idf1(self) -> float:
        names, tracks = list(self._there), list(self._told)
        shared = np.zeros((len(names), len(tracks)))
        row = {name: i for i, name in enumerate(names)}
        column = {track: j for j, track in enumerate(tracks)}
        for (name, track), count in self._together.items():
            shared[row[name], column[track]] = count
        right = float(shared[linear_sum_assignment(-shared)].sum())
        everything = sum(self._told.values()) + sum(self._there.values())
        return 2.0 * right / everything if everything else 1.0


def _gospa(apart: Floats) -> float:
    """Of distances (true, told), metres."""
    half = CUT_OFF_M**2 / 2.0
    cost = np.minimum(apart, CUT_OFF_M) ** 2
    rows, columns = linear_sum_assignment(cost)
    paired = cost[rows, columns] < CUT_OFF_M**2
    alone = sum(apart.shape) - 2 * int(paired.sum())
    return float(np.sqrt(cost[rows, columns][paired].sum() + half * alone))
