"""Early fusion of whole, uncoded clouds: what the codec's early fusion is compared with."""

from __future__ import annotations

import numpy as np

from perception.detector.finders import Finder
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.detectors import shared_finder
from perception.fusion.known import without_own
from perception.types import Boxes, clean_points
from swarm.geometry import Matrix, Points, invert, transform

EARLY_UNCODED = "early-uncoded"


class UncodedEarly(Fusion):
    """Three float32 a point, ground included."""

    name = EARLY_UNCODED
    scored_as = "early"

    def __init__(self, detector: str) -> None:
        self._finder = shared_finder(detector)

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """The points as they are."""
        return clean_points(points).astype("<f4").tobytes()

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts the merged cloud with the own scan."""
        return _Clouds(self._finder, own, world_from_own)


class _Clouds(Gathering):
    def __init__(self, finder: Finder, own: Points, world_from_own: Matrix) -> None:
        self._finder = finder
        self._world_from_own = world_from_own
        self._clouds = [clean_points(own)]
        self._senders: list[Matrix] = []

    def add(self, contribution: Contribution) -> None:
        points = np.frombuffer(contribution.payload, "<f4").reshape(-1, 3)
        self._senders.append(invert(self._world_from_own) @ contribution.world_from_sensor)
        self._clouds.append(transform(self._senders[-1], points))

    def finish(self) -> Boxes:
        found = self._finder.find(np.concatenate(self._clouds), self._senders)
        found = without_own(found, self._finder.config.own_body_m)
        return found.transformed(self._world_from_own)
