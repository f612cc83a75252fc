"""The frames that precision is measured on: worlds that training never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from research.training.plans import TEST_SEEDS
from worlds.base import World
from worlds.registry import open_world

WORLDS = ("factory", "road", "opv2v")
ROBOTS = {"factory": 6, "road": 2, "opv2v": 2}
"""That take part, the ego included."""
FRAMES_OF_WORLD = 5
"""Frames of one floor or street, as far apart as it allows."""
FIRST_FRAME = 9
"""Contributions of half a second ago must exist, and those of the ego's frame before."""


@dataclass(frozen=True, slots=True)
class Part:
    """Frames of one world, seen from one ego."""

    world: str
    seed: int
    """Of a simulated world."""
    folder: Path | None
    """Of a recorded one."""
    ego: int
    """Its index among the robots."""
    frames: tuple[int, ...]

    def open(self) -> World:
        """The world; no scan is computed yet."""
        return open_world(self.world, data=self.folder, robots=ROBOTS[self.world], seed=self.seed)


def simulated(world: str, frames: int) -> list[Part]:
    """At least `frames` frames of `factory` or `road`, FRAMES_OF_WORLD of each floor or street.

    Egos take turns. Frame numbers differ from seed to seed, since noise is drawn from them.
    """
    step = {"factory": 1100, "road": 18}[world]
    parts = []
    for index in range(-(-frames // FRAMES_OF_WORLD)):
        first = FIRST_FRAME + index * 7 % (step // 2)
        parts.append(
            Part(
                world=world,
                seed=TEST_SEEDS.start + index,
                folder=None,
                ego=index % ROBOTS[world],
                frames=tuple(first + i * step for i in range(FRAMES_OF_WORLD)),
            )
        )
    return parts


def recorded(folder: Path, frames: int) -> list[Part]:
    """Every frame of the OPV2V sample (at most `frames` of each ego), from each of its vehicles."""
    from worlds.opv2v.world import Opv2vWorld

    world = Opv2vWorld(folder)
    count = min(world.frame_count, frames)
    return [Part("opv2v", 0, folder, ego, tuple(range(count))) for ego in range(len(world.robots))]


def nearest_first(world: World, ego: str, frame: int) -> Sequence[str]:
    """The ego, then the other robots by their distance from it."""
    here = world.pose(ego, frame)
    return sorted(
        world.robots, key=lambda robot: (robot != ego, world.pose(robot, frame).distance_to(here))
    )
