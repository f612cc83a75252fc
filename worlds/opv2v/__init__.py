"""OPV2V: recorded drives of connected vehicles, simulated in CARLA (Xu et al., ICRA 2022)."""

from __future__ import annotations

from pathlib import Path

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest
from worlds.sample import opv2v_sample


def _open(request: WorldRequest) -> World:
    from worlds.opv2v.world import Opv2vWorld

    return Opv2vWorld(Path(request.data), request.cache)


def _found(path: Path) -> str:
    depths = ("data_protocol.yaml", "*/data_protocol.yaml", "*/*/data_protocol.yaml")
    there = path.is_dir() and any(any(path.glob(depth)) for depth in depths)
    return "a scenario in OPV2V's layout" if there else ""


NEEDS = "the directory of a recorded scenario"
WORLDS = (WorldKind("opv2v", _open, "directory", NEEDS, opv2v_sample, _found, detector="road"),)
