"""Choosers beside `coverage`: what the figures say of those whose answers are known."""

from __future__ import annotations

import pytest

from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting.letters import helpers
from llm_gateway.model import Prompt
from research.evaluation.decisions.choosers import (
    ByModel,
    ByOption,
    ByPolicy,
    Case,
    Oracle,
    at_random,
    by_rule,
    first_k,
)
from research.evaluation.decisions.measure import cases, row, wanted
from research.evaluation.policies.advice import Answer
from research.training.decisions.network import Lesson, learn
from research.training.decisions.scenes import TEST

GROUPS = 3


@pytest.fixture(scope="module")
def asked() -> list[Case]:
    return cases(TEST, 5, GROUPS)


class Saying:
    """A language model that always says the same."""

    name = "saying"

    def __init__(self, text: str) -> None:
        self.text = text
        self.prompts: list[Prompt] = []

    def ask(self, prompt: Prompt) -> Answer:
        self.prompts.append(prompt)
        return Answer(self.text, "", 0.25, (90 + len(self.prompts), 5))


def test_coverage_equals_itself_and_follows_every_step_of_the_link(asked: list[Case]) -> None:
    report, said = row(ByPolicy("coverage", Coverage()), asked)
    assert report["equal_to_coverage"] == 1.0
    assert report["link_steps"] > 0
    assert report["link_steps_followed"] == 1.0
    assert len(said) == report["answers"] == GROUPS * len(TEST.rates_bps)


def test_no_set_is_better_than_the_oracles_but_for_what_a_change_of_pace_must_gain(
    asked: list[Case],
) -> None:
    best, _ = row(Oracle(), asked)
    for chooser in (at_random(1), ByOption("first k", first_k), ByOption("rule", by_rule)):
        report, _ = row(chooser, asked)
        assert report["value_lost"] >= best["value_lost"] - 1e-9
        assert report["readable"] == 1.0
        assert report["judged_value_lost"] <= 0.005


def test_what_cannot_be_read_loses_what_the_ego_alone_does_and_is_not_adopted(
    asked: list[Case],
) -> None:
    model = Saying("I would take the robots nearby.")
    report, _ = row(ByModel(model, bound=False), asked)
    assert (report["readable"], report["adopted"], report["equal_to_coverage"]) == (0.0, 0.0, 0.0)
    assert report["judged_equal"] == 1.0
    assert report["value_lost"] > 0.0
    assert report["ms_p50"] == 250.0
    assert report["prompt_tokens_most"] == 90 + report["answers"]
    assert report["answer_tokens_p50"] == 5
    assert {prompt.schema for prompt in model.prompts} == {""}


def test_a_model_is_asked_with_the_short_prompt_and_its_letters_are_read(
    asked: list[Case],
) -> None:
    model = Saying('"early A"')
    chooser = ByModel(model)
    case = next(case for case in asked if (("early", 1),) in case.options)
    assert chooser.choose(case).sends == {case.short.robots[0]: "early"}
    assert model.prompts[0].messages[0].content == "Pick helpers."


def test_answers_in_groups_are_read_robot_by_robot(asked: list[Case]) -> None:
    case = next(case for case in asked if (("early", 1), ("late", 1)) in case.options)
    first, second = case.short.robots[:2]
    sends = ByModel(Saying('"early A late B"')).choose(case).sends
    assert sends == {first: "early", second: "late"}


def test_the_rule_leaves_out_who_is_not_worth_the_price(asked: list[Case]) -> None:
    for case in asked:
        groups = by_rule(case.short, case.options)
        assert groups in case.options
        if groups:
            name, count = groups[-1]
            fewer = (*groups[:-1], *(((name, count - 1),) if count > 1 else ()))
            if fewer in case.options:
                assert case.short.adds[helpers(groups) - 1] >= case.short.price[name]


def test_the_network_learns_what_it_is_taught_and_equal_seeds_learn_alike(
    asked: list[Case],
) -> None:
    # Few scenes teach only what is plain to see: to stay as small as may be.
    lessons = [Lesson(c.short, c.options, min(c.options, key=helpers)) for c in asked]
    network = learn(lessons, 1)
    assert network.parameter_count < 5_000
    right = sum(
        helpers(network.choose(one.short, one.options)) == helpers(one.answer) for one in lessons
    )
    assert right >= 0.8 * len(lessons)
    again = learn(lessons, 1)
    assert [again.choose(one.short, one.options) for one in lessons] == [
        network.choose(one.short, one.options) for one in lessons
    ]


def test_what_is_wanted_is_what_coverage_chooses(asked: list[Case]) -> None:
    best, _ = Coverage().choose(asked[0].scorer, None)
    assert wanted(asked[0]) == best
