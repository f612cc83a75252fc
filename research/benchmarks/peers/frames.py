"""The frames that peers are measured on: real ones where they are at hand, else simulated ones."""

from __future__ import annotations

from dataclasses import dataclass

from research.training.plans import TEST_SEEDS
from swarm.errors import WorldError
from worlds.base import Scan, World
from worlds.opv2v.world import Opv2vWorld
from worlds.registry import open_world
from worlds.sample import opv2v_sample

FRAMES = 6
VEHICLES = 2


@dataclass(frozen=True, slots=True)
class Shared:
    """Scans of two vehicles that share what they see, frame by frame, the ego first."""

    name: str
    detector: str
    scans: tuple[tuple[Scan, ...], ...]


def shared_frames() -> Shared:
    """Of the OPV2V sample, else of a simulated street that nothing was trained on; spread over
    all that there is."""
    try:
        return _read("OPV2V sample", Opv2vWorld(opv2v_sample()))
    except WorldError:
        return _read("simulated street", open_world("road", robots=2, seed=TEST_SEEDS.start))


def _read(name: str, world: World) -> Shared:
    step = max(1, world.frame_count // FRAMES)
    frames = range(0, world.frame_count, step)[:FRAMES]
    ids = world.robots[:VEHICLES]
    scans = tuple(tuple(world.scan(robot, frame) for robot in ids) for frame in frames)
    return Shared(name, world.detector, scans)
