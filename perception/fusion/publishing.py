"""From what was fused to what is told: known robots apart, and of the rest what is likely there."""

from __future__ import annotations

from collections.abc import Sequence

from perception.detector.calibration import calibration_of
from perception.fusion.base import Fusion
from perception.fusion.known import KnownRobot, without_known
from perception.types import Boxes


def publish(
    found: Boxes,
    detector: str,
    algorithm: str | Fusion,
    helpers: int,
    known: Sequence[KnownRobot],
) -> Boxes:
    """Detections: the fused boxes without those of known robots, above the operating point.

    Boxes and robots in one frame of reference. `algorithm` has fused them, `helpers` robots took
    part beside the ego. Raises PerceptionError for a calibration that cannot be used.
    """
    kept = without_known(found, known)
    return calibration_of(detector).published(kept, scored_as(algorithm), helpers)


def chances(
    found: Boxes,
    detector: str,
    algorithm: str | Fusion,
    helpers: int,
    known: Sequence[KnownRobot],
) -> Boxes | None:
    """As `publish`, with those below the operating point; None where nobody has calibrated."""
    calibration, name = calibration_of(detector), scored_as(algorithm)
    if name not in calibration.curves:
        return None
    return calibration.judged(without_known(found, known), name, helpers)


def operating_point(detector: str, algorithm: str | Fusion) -> float | None:
    """The chance from which on `publish` keeps a box; None where it keeps all with scores of their
    own. Raises PerceptionError as `publish` does."""
    calibration = calibration_of(detector)
    return calibration.least_chance if scored_as(algorithm) in calibration.curves else None


def scored_as(algorithm: str | Fusion) -> str:
    """The name of the algorithm whose calibration the scores have."""
    if isinstance(algorithm, str):
        return algorithm
    return algorithm.name if algorithm.scored_as is None else algorithm.scored_as
