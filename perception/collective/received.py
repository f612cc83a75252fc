"""What others told by collective perception messages, held until they tell it again.

Stations tell what changes: an object that is not in a message is no evidence that it is gone. So
each is held, moved by its own velocity, until the longest time between two messages about it has
passed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.types import Boxes

HELD_S = 1.1
"""A station tells of everything once a second; a little is for the way."""
MAX_HELD = 512
"""Objects of one station; more are no traffic, but a fault."""


@dataclass(frozen=True, slots=True)
class _Held:
    at_s: float
    box: Boxes
    velocity: NDArray[np.float64]


class Received:
    """The objects of one station. For one thread."""

    def __init__(self) -> None:
        self._held: dict[int, _Held] = {}

    def take(
        self, at_s: float, ids: tuple[int, ...], boxes: Boxes, velocities: NDArray[np.float64]
    ) -> None:
        """A message of that moment: objects by the station's numbers, their boxes in the world
        frame, and their velocities (N, 2), m/s. Of what is older than is held already, nothing."""
        for row, id_ in enumerate(ids):
            before = self._held.get(id_)
            if before is None or before.at_s <= at_s:
                box = boxes.take(np.array([row]))
                self._held[id_] = _Held(at_s, box, velocities[row].astype(np.float64))
        newest = sorted(self._held, key=lambda one: self._held[one].at_s)[-MAX_HELD:]
        self._held = {one: self._held[one] for one in newest}

    def at(self, now_s: float) -> Boxes:
        """All that is held, moved to that moment, in the world frame."""
        self._held = _fresh(self._held, now_s)
        moved = []
        for one in self._held.values():
            centers = one.box.centers.copy()
            centers[:, :2] += (now_s - one.at_s) * one.velocity
            moved.append(replace(one.box, centers=centers))
        return Boxes.concatenate(moved) if moved else Boxes.empty()


def _fresh(held: Mapping[int, _Held], now_s: float) -> dict[int, _Held]:
    return {id_: one for id_, one in held.items() if now_s - one.at_s <= HELD_S}
