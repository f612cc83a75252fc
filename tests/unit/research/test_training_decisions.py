"""Examples for learning decisions: they are what `coverage` decides, and training is no test."""

from __future__ import annotations

import json
from itertools import islice

from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting import read_answer
from ego_agent.plan.prompting.letters import short_answer
from ego_agent.plan.prompting.short import make_short_prompt
from research.training.decisions.examples import examples, many, taught
from research.training.decisions.scenes import TEST, TRAINING, known, scene_groups


def test_equal_seeds_give_equal_examples_and_others_do_not() -> None:
    first, same, other = (list(islice(examples(seed), 6)) for seed in (1, 1, 2))
    assert first == same != other


def test_the_answer_is_what_coverage_decides() -> None:
    knowledge, equal = known(), 0
    for scene in next(scene_groups(TEST, 3)):
        scorer = Scorer(scene, knowledge)
        _, groups, decided = taught(scorer)
        assert groups is not None
        prompt = make_short_prompt(scene, knowledge, None, None)
        answer = short_answer(groups)
        assert answer in json.loads(prompt.schema)["enum"]
        said = read_answer(json.dumps(answer), prompt)
        best, _ = Coverage().choose(scorer, None)
        assert decided == best
        sends = dict.fromkeys(said.participants[1:], said.algorithm) | {**said.forms}
        equal += sends == {robot: best.algorithm_of(robot) for robot in best.participants}
    assert equal == len(TEST.rates_bps)


def test_how_many_processes_make_examples_changes_nothing() -> None:
    first, same = many(1, 10, 1), many(1, 10, 2)
    assert first == same
    assert len(first) == 10


def test_training_and_test_share_no_floor_and_no_number_of_robots() -> None:
    assert not set(TRAINING.seeds) & set(TEST.seeds)
    assert not set(TRAINING.robots) & set(TEST.robots)


def test_one_scene_comes_at_rising_rates() -> None:
    group = next(scene_groups(TRAINING, 4))
    rates = [scene.capacity_bps for scene in group]
    assert rates == sorted(rates)
    assert len({tuple(c.robot for c in scene.candidates) for scene in group}) == 1
