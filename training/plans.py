"""How each detector is trained: worlds, seeds, steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swarm.errors import PerceptionError
from training.samples import ActorWorld

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


def _factory(rng: np.random.Generator) -> ActorWorld:
    from worlds.factory import FactoryWorld
    from worlds.factory.scenarios import SCENARIOS

    return FactoryWorld(
        robots=int(rng.integers(3, 10)),
        seed=int(rng.integers(1000, TEST_SEEDS.start)),
        rings=int(rng.choice([16, 32, 32, 32, 32, 64])),
        scenario=str(rng.choice(SCENARIOS)),
    )


def _road(rng: np.random.Generator) -> ActorWorld:
    from worlds.road import RoadWorld

    return RoadWorld(robots=int(rng.integers(1, 4)), seed=int(rng.integers(1000, TEST_SEEDS.start)))


_PLANS = (
    Plan("factory", _factory, reach_m=45.0, steps=3000, batch=4, rate=2e-3, seed=1),
    Plan("road", _road, reach_m=70.0, steps=2500, batch=4, rate=2e-3, seed=2),
)


def plan(name: str) -> Plan:
    """The plan for the detector of that name. Raises PerceptionError for an unknown one."""
    for one in _PLANS:
        if one.config == name:
            return one
    allowed = ", ".join(one.config for one in _PLANS)
    raise PerceptionError(f"there is no training plan {name!r}; allowed: {allowed}")
