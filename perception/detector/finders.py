"""Points to boxes: what early and late fusion need of a detector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from perception.detector.config import DetectorConfig, configuration
from perception.detector.grid import BevConfig, bev_config
from perception.types import Boxes
from swarm.geometry import Matrix, Points

if TYPE_CHECKING:
    from perception.detector.learned import Detector


class Finder(Protocol):
    """Finds boxes in a cloud."""

    config: DetectorConfig

    @property
    def area(self) -> BevConfig | None:
        """Points outside of it find nothing; None: all count."""
        ...

    def find(self, points: Points, here_from_others: Sequence[Matrix] = ()) -> Boxes:
        """The boxes in a cloud float32 (N, 3), in its frame, best score first.

        `here_from_others`: the other sensors that the cloud was merged from; one is at the origin.
        """
        ...


class Learned:
    """The learned detector: see `perception.detector.learned`."""

    def __init__(self, name: str, detector: Detector | None = None) -> None:
        """`detector`: of that configuration; by default one with the weights that are there."""
        from perception.detector.learned import Detector

        self.config = configuration(name)
        self.area: BevConfig | None = bev_config(name)
        self.detector = Detector(name) if detector is None else detector

    def find(self, points: Points, here_from_others: Sequence[Matrix] = ()) -> Boxes:
        """See `Finder.find`."""
        return self.detector.detect(points)


class Clustered:
    """Boxes around clusters: see `perception.detector.detect`. Needs no weights."""

    area: BevConfig | None = None

    def __init__(self, name: str) -> None:
        self.config = configuration(name)

    def find(self, points: Points, here_from_others: Sequence[Matrix] = ()) -> Boxes:
        """See `Finder.find`."""
        from perception.detector.bodies import without_bodies
        from perception.detector.detect import detect

        cloud = without_bodies(points, here_from_others, self.config.usual_body)
        origins = np.stack([np.zeros(3), *(sensor[:3, 3] for sensor in here_from_others)])
        return detect(cloud, self.config, origins)
