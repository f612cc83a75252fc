"""Measures random choices in training windows, each window once."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from perception.fusion.registry import fusion_names
from research.evaluation.policies.work_items import MADE_FROM
from research.evaluation.result_store import ResultStore
from research.evaluation.surrogate.samples import scene_of
from research.evaluation.windows import announcements
from research.evaluation.windows.choice import ALONE, Choice
from research.evaluation.windows.measure import Window, candidates_of, packed
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.workers import each
from swarm.messages import ALGORITHMS

SAMPLES_FROM = (
    *MADE_FROM,
    "research/evaluation/surrogate/measuring.py",
    "research/evaluation/windows/measure.py",
    "research/evaluation/windows/precision.py",
)
"""What decides what is measured: outcomes, where a comparison keeps fused frames."""
CHOICES = 24
"""Measured in each window."""
PARADIGM_SHARE = 2 / 3
"""Of the random choices use one of the three paradigms that an ego decides among by default."""


def measured_windows(scenarios: Sequence[Scenario], workers: int, folder: Path) -> list[list[Any]]:
    """What `measure` returns of each; what is known is kept in the folder."""
    kept = ResultStore(folder / "kept", SAMPLES_FROM)
    keys = [key_of(scenario) for scenario in scenarios]
    known = [kept.get(key) for key in keys]
    missing = [at for at, values in enumerate(known) if values is None]
    detector = scenarios[0].detector
    work = each(measure, [scenarios[at] for at in missing], workers, detector)
    for done, (place, values) in enumerate(work, 1):
        known[missing[place]] = values
        kept.put(keys[missing[place]], values)
        print(f"measured {done}/{len(missing)} windows", file=sys.stderr, flush=True)
    return [values for values in known if values is not None]


def key_of(scenario: Scenario) -> str:
    """By which what was measured in a window is kept."""
    return f"surrogate {scenario.setting()} {scenario.sampled_frames(0)}"


def measure(scenario: Scenario) -> list[Any]:
    """Measures CHOICES choices of a scenario's window, as plain values for `samples`."""
    window = Window(scenario, 0)
    reach_m = scenario.comm_range_m + 1.0
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
    candidates = candidates_of(scene_of(window.ego, messages, scenario.detector))
    for choice in random_choices(candidates, fusion_names(window.world.detector), scenario.seed):
        window.outcome(choice)
    return [window.ego, announcements.packed(messages), packed(window.outcomes)]


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
