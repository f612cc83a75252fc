"""One learned detector for all algorithms of a process: weights take memory and time to load."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from perception.detector.finders import Clustered, Finder, Learned
from perception.detector.weight_files import has_weights

if TYPE_CHECKING:
    from perception.detector.learned import Detector


@cache
def _learned(name: str) -> Learned:
    return Learned(name)


def shared_detector(name: str) -> Detector:
    """The learned detector of a configuration. Raises PerceptionError without weights."""
    return _learned(name).detector


def shared_finder(name: str) -> Finder:
    """The learned detector where there are weights, else the one without learning."""
    return _learned(name) if has_weights(name) else Clustered(name)


def detector_backend(name: str) -> str:
    """What runs the detector of a configuration in this process: a name of
    `perception.detector.backends`, or `clustered` where there are no weights."""
    return _learned(name).detector.backend.name if has_weights(name) else "clustered"
