"""Fusion algorithms by name."""

from __future__ import annotations

from collections.abc import Callable

from perception.detector import DetectorConfig, configuration
from perception.fusion.base import Fusion
from perception.fusion.early import EarlyFusion
from perception.fusion.late import LateFusion
from swarm.errors import PerceptionError

_FUSIONS: dict[str, Callable[[DetectorConfig], Fusion]] = {
    EarlyFusion.name: EarlyFusion,
    LateFusion.name: LateFusion,
}


def fusion_names() -> tuple[str, ...]:
    """The algorithms that can be used now."""
    return tuple(_FUSIONS)


def make_fusion(name: str, detector: str) -> Fusion:
    """The algorithm of that name with a detector configuration (`road` or `factory`).

    Raises PerceptionError for a name that is unknown or not available.
    """
    if name not in _FUSIONS:
        why = "needs a learned detector, which is not there yet" if name == "intermediate" else ""
        raise PerceptionError(
            f"fusion {name!r} is not available{f': it {why}' if why else ''}; "
            f"allowed: {', '.join(_FUSIONS)}"
        )
    return _FUSIONS[name](configuration(detector))
