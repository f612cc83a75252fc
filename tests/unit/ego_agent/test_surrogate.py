"""The surrogate: what it sees of a choice, its file, and the choices it finds."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save_file

from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.validation import validate
from ego_agent.plan.policies.surrogate import BySurrogate
from ego_agent.plan.surrogate.estimate import Estimate
from ego_agent.plan.surrogate.features import NAMES, SceneFeatures, with_algorithm
from ego_agent.plan.surrogate.model import (
    Surrogate,
    packaged_surrogate,
    read_surrogate,
    write_surrogate,
)
from swarm.errors import DecisionError
from swarm.geometry import Pose
from swarm.messages import Decision
from tests.support.ego_scenes import assert_valid, candidate, knowledge, scene

ALGORITHMS = ("early", "late")
INPUTS = len(NAMES) + len(ALGORITHMS)
GROWING = (
    "area_near", "area", "evidence_near", "evidence_twice", "evidence_mean", "robots_seen",
    "robots_view", "robots_in", "participants", "participants_near",
)  # fmt: skip


def random_model(seed: int = 3) -> Surrogate:
    rng = np.random.default_rng(seed)
    wide = (INPUTS, 8, 8, 1)
    weights = tuple(rng.normal(0, 0.7, (b, a)).astype(np.float32) for a, b in pairwise(wide))
    biases = tuple(rng.normal(0, 0.3, b).astype(np.float32) for b in wide[1:])
    return Surrogate(ALGORITHMS, weights, biases, {"windows": "0"})


def random_scene(robots: int, seed: int = 1, capacity_bps: float = 20e6) -> UnifiedScene:
    rng = np.random.default_rng(seed)
    found = []
    for index in range(robots):
        one = candidate(
            f"R{index + 1}",
            np.flatnonzero(rng.random(400) < 0.3).tolist(),
            rng.random(6).tolist(),
            of=(20, 6),
            sizes={"early": int(rng.integers(2_000, 9_000)), "late": int(rng.integers(200, 600))},
        )
        x, y = rng.uniform(-9, 9, 2).tolist() if index else (0.0, 0.0)
        found.append(replace(one, pose=Pose(x, y, 1.2), distance_m=float(np.hypot(x, y))))
    return scene(*found, capacity_bps=capacity_bps)


def members(*sets: tuple[int, ...], robots: int) -> NDArray[np.bool_]:
    table = np.zeros((len(sets), robots), dtype=np.bool_)
    for row, one in enumerate(sets):
        table[row, list(one)] = True
    return table


def test_one_more_participant_never_shows_less() -> None:
    features = SceneFeatures(random_scene(6))
    before, after = features.sets(members((1, 2), (1, 2, 4), robots=6))
    for name, less, more in zip(NAMES, before, after, strict=True):
        if name in GROWING:
            assert more >= less, name
    everyone, alone = features.sets(members((1, 2, 3, 4, 5), (), robots=6))
    seen = dict(zip(NAMES, everyone.tolist(), strict=True))
    assert seen["area_near"] == seen["area"] == seen["evidence_near"] == seen["robots_in"] == 1
    none = dict(zip(NAMES, alone.tolist(), strict=True))
    assert none["participants"] == none["distance_mean"] == none["distance_least"] == 0
    assert none["area_near"] < 1


def test_a_robot_behind_something_is_not_in_view() -> None:
    ego = candidate("R1", (), of=(20, 0))
    line = ego.area.copy()
    line[10, 10:16] = True
    ego = replace(ego, area=line, pose=Pose(0.0, 0.0, 1.2))
    blind = replace(ego, area=np.zeros_like(line))
    near = replace(candidate("R2", of=(20, 0)), pose=Pose(6.0, 0.2, 1.2))
    hidden = replace(candidate("R3", of=(20, 0)), pose=Pose(9.5, 0.2, 1.2))
    column = NAMES.index("robots_seen")
    shown = SceneFeatures(scene(ego, near, hidden)).sets(members((), robots=3))
    assert shown[0, column] == 0.5
    assert SceneFeatures(scene(blind, near, hidden)).sets(members((), robots=3))[0, column] == 0


def test_a_scene_without_anything_has_finite_features() -> None:
    empty = scene(candidate("R1", of=(20, 0)))
    assert np.isfinite(SceneFeatures(empty).sets(members((), robots=1))).all()


def test_a_file_gives_back_the_model(tmp_path: Path) -> None:
    model, path = random_model(), tmp_path / "model.safetensors"
    write_surrogate(path, model)
    again = read_surrogate(path)
    rows = np.random.default_rng(0).random((5, INPUTS), dtype=np.float32)
    assert (again.predict(rows) == model.predict(rows)).all()
    assert again.algorithms == ALGORITHMS
    assert again.facts == {"windows": "0"}
    first = path.read_bytes()
    write_surrogate(path, model)
    assert path.read_bytes() == first


def tensors(model: Surrogate) -> dict[str, Any]:
    found = {f"weight{i}": weight for i, weight in enumerate(model.weights)}
    return found | {f"bias{i}": bias for i, bias in enumerate(model.biases)}


FACTS = {"features": list(NAMES), "algorithms": list(ALGORITHMS)}


@pytest.mark.parametrize(
    ("change", "facts", "words"),
    [
        ({}, {**FACTS, "features": ["colour"]}, "was trained on other features"),
        ({}, {**FACTS, "algorithms": []}, "was trained on other features"),
        ({"weight1": None}, FACTS, "has no 'weight1'"),
        ({"weight1": np.zeros((8, 9), np.float32)}, FACTS, "has layers of"),
        ({"bias2": np.zeros(2, np.float32)}, FACTS, "has layers of"),
        ({"bias0": np.full(8, np.nan, np.float32)}, FACTS, "not finite"),
        ({"bias0": np.zeros(400_000, np.float32)}, FACTS, "is larger than 1000000 bytes"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(
    change: dict[str, Any], facts: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "model.safetensors"
    found = {k: v for k, v in {**tensors(random_model()), **change}.items() if v is not None}
    save_file(found, path, {"facts": json.dumps(facts)})
    with pytest.raises(DecisionError, match=words):
        read_surrogate(path)


def test_a_file_that_is_missing_or_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    with pytest.raises(DecisionError, match="there is no surrogate"):
        read_surrogate(path)
    path.write_bytes(b"not a model")
    with pytest.raises(DecisionError, match="is not a safetensors file"):
        read_surrogate(path)


def test_few_candidates_are_searched_completely() -> None:
    robots = random_scene(5, capacity_bps=1e6)
    scorer = Scorer(robots, knowledge(ALGORITHMS))
    estimate = Estimate(scorer, random_model())
    options = {(o.participants, o.algorithm): o for o in estimate.options()}
    names = [c.robot for c in robots.candidates]
    for algorithm in ALGORITHMS:
        for size in range(1, 5):
            for chosen in combinations(names, size):
                alone = estimate.score(chosen, algorithm)
                found = options.get((chosen, algorithm))
                assert (found is not None) == (alone.cost_bytes <= scorer.budget_bytes)
                if found is not None:
                    assert found.quality == pytest.approx(alone.quality, rel=1e-6)
    assert ((), "early") in options


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("robots", [2, 5, 20])
def test_what_it_proposes_holds(robots: int, seed: int) -> None:
    floor, known = random_scene(robots, seed, capacity_bps=2e6), knowledge(ALGORITHMS)
    policy = BySurrogate(model=random_model(seed))
    proposal = policy.propose(floor, known, None)
    decision = validate(proposal, floor, known, policy="surrogate", cycle=0, now_ns=0)
    assert isinstance(decision, Decision)
    assert not decision.repairs
    assert_valid(decision, floor, known)
    estimate = Estimate(Scorer(floor, known), random_model(seed))
    chosen = estimate.score(proposal.participants, proposal.algorithm)
    others = [o for o in estimate.options() if o.quality >= known.objective.q_min]
    assert chosen.quality >= known.objective.q_min or not others
    assert all(chosen.value >= other.value - 1e-5 for other in others)
    assert policy.propose(floor, known, decision).participants == proposal.participants


def test_a_robot_whose_link_cannot_carry_it_is_no_option() -> None:
    floor = random_scene(4)
    slow = replace(floor.candidates[0], capacity_bps=1_000.0)
    floor = replace(floor, candidates=(slow, *floor.candidates[1:]))
    options = Estimate(Scorer(floor, knowledge(ALGORITHMS)), random_model()).options()
    assert not any(slow.robot in option.participants for option in options)


def test_the_packaged_surrogate_knows_every_algorithm_and_prefers_seeing_to_blindness() -> None:
    model = packaged_surrogate()
    floor = random_scene(6)
    sets = SceneFeatures(floor).sets(members((), (1, 2, 3, 4, 5), robots=6))
    alone, everyone = model.predict(with_algorithm(sets, ["", "early"], model.algorithms))
    assert everyone > alone
