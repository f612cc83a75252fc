"""CoAdapt Edge for scripts and notebooks; the command line `coadapt` is the way to everything else.

    import coadapt

    ego, other = coadapt.scan("a.pcd", pose_a), coadapt.scan("b.bin", pose_b)
    coadapt.describe(ego)
    coadapt.decode(coadapt.encode(ego, max_error_m=0.1))
    fused = coadapt.fuse([ego, other], algorithm="early")
    fused.above(0.5)
    coadapt.draw(fused, "fused.png")

Lengths are metres, angles radians. A sensor's frame has x forward, y left and z up; a pose says
where the sensor stands in the world.
What is not used is not loaded: PyTorch comes with the first `fuse`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coadapt.api.cloud import Cloud
    from coadapt.api.drawing import Drawing, draw
    from coadapt.api.fusing import Fused, fuse
    from coadapt.api.scans import decode, describe, encode, scan, world
    from perception.types import Boxes, Scene, SceneObject
    from swarm.errors import CoAdaptError
    from swarm.geometry import Pose

_HOMES = {
    "Boxes": "perception.types",
    "Cloud": "coadapt.api.cloud",
    "CoAdaptError": "swarm.errors",
    "Drawing": "coadapt.api.drawing",
    "Fused": "coadapt.api.fusing",
    "Pose": "swarm.geometry",
    "Scene": "perception.types",
    "SceneObject": "perception.types",
    "decode": "coadapt.api.scans",
    "describe": "coadapt.api.scans",
    "draw": "coadapt.api.drawing",
    "encode": "coadapt.api.scans",
    "fuse": "coadapt.api.fusing",
    "scan": "coadapt.api.scans",
    "world": "coadapt.api.scans",
}

__all__ = [
    "Boxes",
    "Cloud",
    "CoAdaptError",
    "Drawing",
    "Fused",
    "Pose",
    "Scene",
    "SceneObject",
    "decode",
    "describe",
    "draw",
    "encode",
    "fuse",
    "scan",
    "world",
]


if not TYPE_CHECKING:  # a type checker would take every name for one that is there

    def __getattr__(name: str) -> Any:
        """Loads what is asked for, when it is asked for."""
        if name not in _HOMES:
            raise AttributeError(f"module 'coadapt' has no attribute {name!r}")
        found = getattr(importlib.import_module(_HOMES[name]), name)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted(__all__)
