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
    if isinstance(algorithm, Fusion):
        scored_as = algorithm.scored_as
        algorithm = algorithm.name if scored_as is None else scored_as
    return calibration_of(detector).published(without_known(found, known), algorithm, helpers)
