"""Training samples: choices in control windows, their features and their measured precision."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
from perception.fusion.registry import fusion_names
from research.evaluation.windows import announcements
from research.evaluation.windows.announcements import Announced
from research.evaluation.windows.choice import ALONE, Choice
from research.evaluation.windows.links import shift
from research.evaluation.windows.measure import Window, candidates_of, packed, unpacked
from research.evaluation.windows.scenarios import NOISE_M, SURROGATE_SEEDS, Scenario
from swarm.messages import ALGORITHMS
from worlds.factory.scenarios import SCENARIOS

CHOICES = 24
"""Measured in each window..."""
FRAMES = 4
"""...on so many frames: many different windows teach more than much of one."""
PARADIGM_SHARE = 2 / 3
"""Of the random choices use one of the three paradigms that an ego decides among by default."""
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


def training_windows(count: int) -> list[Scenario]:
    """Scenarios of one window each, all on floors of their own."""
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


def measure(scenario: Scenario) -> list[Any]:
    """Measures CHOICES choices of a scenario's window, as plain values for `samples`."""
    window = Window(scenario, 0)
    reach_m = Objective().comm_range_m + 1.0
    # Sizes play no part in the features: one algorithm's make everyone in range a candidate.
    fusions = {"late": window.fusion("late")}
    messages = announcements.heard(
        window.world,
        scenario.decision_frame(0),
        window.ego,
        dict(fusions),
        scenario.pose_noise_m,
        reach_m,
    )
    candidates = candidates_of(_scene(window.ego, messages))
    for choice in random_choices(candidates, fusion_names(window.world.detector), scenario.seed):
        window.outcome(choice)
    return [window.ego, announcements.packed(messages), packed(window.outcomes)]


def samples(values: Sequence[Any], algorithms: Sequence[str]) -> Samples | None:
    """The features and precisions of what `measure` returned; None without a true box."""
    ego, messages, measured = values
    outcomes = unpacked(measured)
    if not next(iter(outcomes.values())).ground_truth:
        return None
    scene = _scene(ego, announcements.unpacked(messages))
    features = choice_features(scene, list(outcomes), algorithms)
    ap_70 = np.array([one.ap_70 for one in outcomes.values()], np.float32)
    halves = [one.halves or (np.nan, np.nan) for one in outcomes.values()]
    return Samples(features, ap_70, np.array(halves, np.float64))


def _scene(ego: str, messages: Announced) -> UnifiedScene:
    return analyze(announcements.snapshot(ego, messages, 1e9), Knowledge())


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


def random_choices(
    candidates: Sequence[str], algorithms: Sequence[str], seed: int
) -> Iterator[Choice]:
    """The ego alone, everyone with every algorithm, and random sets, small ones more often."""
    rng = np.random.default_rng(seed)
    yield Choice((), ALONE)
    if not candidates:
        return
    found = {Choice((), ALONE)}
    for algorithm in algorithms:
        found.add(Choice(tuple(sorted(candidates)), algorithm))
    possible = 1 + len(algorithms) * (2 ** min(len(candidates), 20) - 1)
    while len(found) < min(CHOICES, possible):
        size = min(len(candidates), int(rng.geometric(0.35)))
        members = rng.choice(len(candidates), size, replace=False)
        names = ALGORITHMS if rng.random() < PARADIGM_SHARE else algorithms
        algorithm = names[int(rng.integers(len(names)))]
        found.add(Choice(tuple(sorted(candidates[i] for i in members)), algorithm))
    yield from sorted(found - {Choice((), ALONE)})
