"""Choosers beside `coverage`: what the figures say of those whose answers are known."""

from __future__ import annotations

import pytest

from ego_agent.plan.policies.coverage import Coverage
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
from research.training.decisions.network import learn
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
        return Answer(self.text, "", 0.25)


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
    assert {prompt.schema for prompt in model.prompts} == {""}


def test_a_model_is_asked_with_the_short_prompt_and_its_letters_are_read(
    asked: list[Case],
) -> None:
    model = Saying('"early A"')
    chooser = ByModel(model)
    case = next(case for case in asked if ("early", 1) in case.short.options)
    said = chooser.choose(case)
    assert (said.participants, said.algorithm) == (case.short.robots[:1], "early")
    assert model.prompts[0].messages[0].content == "Pick helpers."


def test_the_rule_leaves_out_who_is_not_worth_the_price(asked: list[Case]) -> None:
    for case in asked:
        name, helpers = by_rule(case.short)
        assert (name, helpers) in case.short.options
        if (name, helpers - 1) in case.short.options and helpers:
            assert case.short.adds[helpers - 1] >= case.short.price[name]


def test_the_network_learns_what_it_is_taught_and_equal_seeds_learn_alike(
    asked: list[Case],
) -> None:
    # Few scenes teach only what is plain to see: to stay as small as may be.
    taught = [(case.short, min(case.short.options, key=lambda o: o[1])) for case in asked]
    network = learn(taught, 1)
    assert network.parameter_count < 5_000
    right = sum(network.choose(short)[1] == helpers for short, (_, helpers) in taught)
    assert right >= 0.8 * len(taught)
    again = learn(taught, 1)
    assert [again.choose(short) for short, _ in taught] == [
        network.choose(short) for short, _ in taught
    ]


def test_what_is_wanted_is_what_coverage_chooses(asked: list[Case]) -> None:
    best, _ = Coverage().choose(asked[0].scorer, None)
    assert wanted(asked[0]) == best
