"""Training samples: choices in control windows, their features and their measured precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.surrogate.features import SceneFeatures, with_algorithm
from research.evaluation.windows import announcements
from research.evaluation.windows.announcements import Announced
from research.evaluation.windows.choice import Choice
from research.evaluation.windows.links import shift
from research.evaluation.windows.measure import candidates_of, unpacked
from research.evaluation.windows.scenarios import NOISE_M, SURROGATE_SEEDS, Scenario
from worlds.factory.scenarios import SCENARIOS
from worlds.registry import world_kind

FRAMES = 4
"""On which a window's choices are measured: many different windows teach more than much of one."""
HELD_OUT = 5
"""One window in so many is for judging what was learnt."""
VEHICLES = (2, 3, 4, 5)
"""On a street, in turn: OPV2V has 2 to 7."""
STREET_FRAMES = 40
"""Windows begin before this one."""
ROBOTS = (3, 4, 5, 6, 6, 7, 8, 9, 10, 12, 16, 24)
"""In turn; the largest are few, since a window of many robots takes long."""

FEWER_RINGS, ROOMIER = 16, 2.0
"""Of other settings: the sensor has 32 rings and a robot its usual share of the floor else."""


@dataclass(frozen=True)
class Samples:
    """Choices in one window."""

    features: NDArray[np.float32]
    """(n, features)."""
    ap_70: NDArray[np.float32]
    """(n,)."""
    halves: NDArray[np.float64]
    """(n, 2): AP@0.7 of the two halves of the frames; NaN where one holds no true box."""


def training_windows(count: int, detector: str = "factory") -> list[Scenario]:
    """Scenarios of one window each, all on floors, or streets, of their own."""
    if detector == "road":
        return [
            Scenario(
                f"street-{index}",
                VEHICLES[index % len(VEHICLES)],
                shift(),
                seed,
                ego=index // len(VEHICLES) % VEHICLES[index % len(VEHICLES)],
                pose_noise_m=NOISE_M if index // len(VEHICLES) % 2 else 0.0,
                first_frame=index * 37 % STREET_FRAMES,
                windows=1,
                sampled=FRAMES,
                generated="road",
            )
            for index, seed in enumerate(islice(SURROGATE_SEEDS, count))
        ]
    return [
        Scenario(
            f"training-{index}",
            ROBOTS[index % len(ROBOTS)],
            shift(),
            seed,
            kind=SCENARIOS[index // 7 % len(SCENARIOS)],
            ego=index // 3 % ROBOTS[index % len(ROBOTS)],
            pose_noise_m=NOISE_M if index // len(ROBOTS) % 2 else 0.0,
            first_frame=index * 397 % 5900,
            windows=1,
            sampled=FRAMES,
        )
        for index, seed in enumerate(islice(SURROGATE_SEEDS, count))
    ]


def other_settings(windows: Sequence[Scenario]) -> dict[str, list[Scenario]]:
    """The same windows from other settings of the generator, by its name: one thing is changed in
    each, to what no training window has."""
    changes: dict[str, dict[str, Any]] = {
        f"{FEWER_RINGS} rings": {"rings": FEWER_RINGS},
        f"pose noise {2 * NOISE_M:g} m": {"pose_noise_m": 2 * NOISE_M},
        f"{ROOMIER:g} times the floor": {"room": ROOMIER},
    }
    return {name: [replace(one, **what) for one in windows] for name, what in changes.items()}


def samples(values: Sequence[Any], algorithms: Sequence[str]) -> Samples | None:
    """The features and precisions of what `measuring.measure` returned; None without a true
    box."""
    ego, messages, measured = values
    outcomes = unpacked(measured)
    if not next(iter(outcomes.values())).ground_truth:
        return None
    scene = scene_of(ego, announcements.unpacked(messages), "factory")
    features = choice_features(scene, list(outcomes), algorithms)
    ap_70 = np.array([one.ap_70 for one in outcomes.values()], np.float32)
    halves = [one.halves or (np.nan, np.nan) for one in outcomes.values()]
    return Samples(features, ap_70, np.array(halves, np.float64))


def scene_of(ego: str, messages: Announced, detector: str) -> UnifiedScene:
    """The scene of an ego that has heard that, in range for robots with that detector."""
    reach_m = world_kind(detector).comm_range_m or Objective().comm_range_m
    knowledge = Knowledge(Objective(comm_range_m=reach_m))
    return analyze(announcements.snapshot(ego, messages, 1e9), knowledge)


def choice_features(
    scene: UnifiedScene, choices: Sequence[Choice], algorithms: Sequence[str]
) -> NDArray[np.float32]:
    """The features of choices in one scene, with a column for each of the algorithms."""
    row_of = {robot: row for row, robot in enumerate(candidates_of(scene), 1)}
    members = np.zeros((len(choices), len(row_of) + 1), dtype=np.bool_)
    for at, choice in enumerate(choices):
        members[at, [row_of[robot] for robot in choice.participants]] = True
    sets = SceneFeatures(scene).sets(members)
    return with_algorithm(sets, [choice.algorithm for choice in choices], algorithms)
