"""How each detector is trained: worlds, seeds, steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from perception.detector.grid import BevConfig, bev_config
from research.training.samples import ActorWorld
from swarm.errors import PerceptionError

TEST_SEEDS = range(1_000_000, 2_000_000)
"""Worlds of these seeds are for evaluation; training draws from the ones below."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One training run."""

    config: str
    """Name of the detector's configuration."""
    world: Callable[[np.random.Generator], ActorWorld]
    """A random world that training may use."""
    reach_m: float
    """How far from the ego helpers may be."""
    steps: int
    batch: int
    """Samples a step."""
    rate: float
    """Highest learning rate."""
    seed: int
    samples_of_world: int = 1
    """Of a batch, that share a world, where making one takes long."""
    part_x_m: float | None = None
    """A sample shows so much of the area along x, half of it, metres; None: all of it. Layers are
    convolutions, so what is learnt on a part holds for the whole."""

    def shown(self) -> BevConfig:
        """The area that a sample shows."""
        config = bev_config(self.config)
        return config if self.part_x_m is None else replace(config, half_x_m=self.part_x_m)

    @property
    def aside_m(self) -> float:
        """How far along x the middle of a sample may lie from the ego."""
        return bev_config(self.config).half_x_m - self.shown().half_x_m


def _factory(rng: np.random.Generator) -> ActorWorld:
    from worlds.factory.scenarios import SCENARIOS
    from worlds.factory.world import FactoryWorld

    return FactoryWorld(
        robots=int(rng.integers(3, 10)),
        seed=int(rng.integers(1000, TEST_SEEDS.start)),
        rings=int(rng.choice([16, 32, 32, 32, 32, 64])),
        scenario=str(rng.choice(SCENARIOS)),
    )


def _road(rng: np.random.Generator) -> ActorWorld:
    from worlds.road.world import RoadWorld

    return RoadWorld(robots=int(rng.integers(1, 4)), seed=int(rng.integers(1000, TEST_SEEDS.start)))


_PLANS = (
    Plan("factory", _factory, reach_m=45.0, steps=3000, batch=4, rate=2e-3, seed=1),
    Plan(
        "road", _road, reach_m=70.0, steps=1600, batch=4, rate=2e-3, seed=2,
        samples_of_world=2, part_x_m=70.4,
    ),
)  # fmt: skip


def plan(name: str) -> Plan:
    """The plan for the detector of that name. Raises PerceptionError for an unknown one."""
    for one in _PLANS:
        if one.config == name:
            return one
    allowed = ", ".join(one.config for one in _PLANS)
    raise PerceptionError(f"there is no training plan {name!r}; allowed: {allowed}")
