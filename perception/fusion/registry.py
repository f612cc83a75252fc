"""Fusion algorithms by name: one for each file of `perception.fusion.algorithms`."""

from __future__ import annotations

import importlib

from perception.detector.config import configuration
from perception.detector.weight_files import has_weights
from perception.fusion import algorithms
from perception.fusion.algorithms import all_fusions
from perception.fusion.base import Fusion
from swarm.errors import PerceptionError

WITHOUT_WEIGHTS = ("early", "late")
"""What works with a detector that has not learnt anything."""


def fusion_names(detector: str) -> tuple[str, ...]:
    """The algorithms that can be used with a detector configuration.

    Raises PerceptionError for an unknown configuration.
    """
    configuration(detector)
    return tuple(name for name in all_fusions() if name in WITHOUT_WEIGHTS or has_weights(detector))


def make_fusion(name: str, detector: str) -> Fusion:
    """The algorithm of that name with a detector configuration (`road` or `factory`).

    >>> from perception.fusion.base import Contribution, EncodeOptions
    >>> from worlds.registry import open_world
    >>> world = open_world("factory", robots=2, rings=16)
    >>> ego, other = world.scan("R1", 0), world.scan("R2", 0)
    >>> fusion = make_fusion("late", "factory")
    >>> payload = fusion.encode(other.points, EncodeOptions())
    >>> sent = Contribution("R2", payload, other.pose.matrix())
    >>> fused = fusion.fuse(ego.points, ego.pose.matrix(), [sent])
    >>> len(fused.boxes) > 10, fused.rejected
    (True, {})

    Raises PerceptionError for a name that is unknown or not available.
    """
    allowed = fusion_names(detector)
    if name not in allowed:
        known = name in all_fusions() and not has_weights(detector)
        why = f" (there are no weights for {detector!r})" if known else ""
        raise PerceptionError(
            f"fusion {name!r} is not available{why}; allowed: {', '.join(allowed)}"
        )
    module = importlib.import_module(f"{algorithms.__name__}.{name.replace('-', '_')}")
    made: Fusion = module.fusion(detector)
    return made
