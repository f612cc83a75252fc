from __future__ import annotations

import json
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.plan.choices.validation import validate
from ego_agent.plan.prompting import LlmPrompt, make_prompt, read_answer
from ego_agent.plan.prompting.schema import MAX_REASON
from swarm.messages import ALGORITHMS, Decision
from tests.support.ego_scenes import NOW_NS, assert_valid, candidate, knowledge, scene
from tests.support.prompt_scenes import floor, parsed, sample

KNOWN = knowledge()
THIRDS = {"A": range(20, 40), "B": range(40, 60)}
NOBODY = scene(candidate("E", range(9)))


def asked(found: UnifiedScene, known: Knowledge = KNOWN) -> LlmPrompt:
    return make_prompt(found, known, None, None)


def admits(prompt: LlmPrompt, algorithm: str, *helpers: str, **changes: Any) -> bool:
    answer = {"algorithm": algorithm, "helpers": [*helpers], "confidence": "low", "explanation": ""}
    return bool(Draft202012Validator(parsed(prompt)).is_valid(answer | changes))


@pytest.mark.parametrize(
    "found", [NOBODY, *(floor(n, KNOWN, bps) for n in (2, 6, 50) for bps in (1.0, 5e6, 20e6, 1e9))]
)
def test_every_schema_is_valid_and_admits_something(found: UnifiedScene) -> None:
    prompt = asked(found)
    Draft202012Validator.check_schema(parsed(prompt))
    assert prompt.schema == asked(found).schema
    answer = sample(parsed(prompt), random.Random(1))
    assert Draft202012Validator(parsed(prompt)).is_valid(answer)


def test_the_ego_alone_can_be_chosen_only_where_that_is_good_enough() -> None:
    others = (candidate("A", range(20, 30)), candidate("B", range(30, 40)))
    assert admits(asked(scene(candidate("E", range(28)), *others)), "late")
    prompt = asked(scene(candidate("E", range(20)), *others))
    assert not admits(prompt, "early")
    assert admits(prompt, "early", "A")


def test_no_fewer_helpers_are_chosen_than_the_least_quality_needs() -> None:
    # A third is seen by each, so Q_min 0.7 needs all three, and 0.6 any two.
    found = scene(candidate("E", range(20)), *(candidate(n, c) for n, c in THIRDS.items()))
    assert not admits(asked(found, knowledge(q_min=0.7)), "early", "A")
    assert admits(asked(found, knowledge(q_min=0.7)), "early", "A", "B")
    assert admits(asked(found, knowledge(q_min=0.6)), "early", "A")


def test_where_the_least_quality_is_out_of_reach_one_helper_is_enough() -> None:
    found = scene(candidate("E", range(20)), *(candidate(n, c) for n, c in THIRDS.items()))
    prompt = asked(found, knowledge(["late"], q_min=0.95))
    assert admits(prompt, "late", "A")
    assert not admits(prompt, "late")


def test_only_candidates_can_be_named_each_once_and_the_ego_is_implied() -> None:
    some = ("R3", "R2", "R4", "R5")
    prompt = asked(floor(6, KNOWN))
    assert admits(prompt, "late", *some)
    assert not admits(prompt, "late", *some, "R9")
    assert not admits(prompt, "late", *some, "R1")
    assert not admits(prompt, "late", *some, "R2")


def test_only_algorithms_that_the_link_carries_for_somebody_can_be_chosen() -> None:
    # 90 kB at 10 Hz with 80 % headroom need 9 Mbit/s.
    assert not admits(asked(floor(6, KNOWN, 8e6)), "early", "R2")
    assert admits(asked(floor(6, KNOWN, 12e6)), "early", "R2")
    assert not admits(asked(floor(6, KNOWN, 1e9)), "intermediate", "R2")


def test_each_algorithm_has_its_own_most_helpers() -> None:
    prompt = asked(floor(6, KNOWN, 25e6))
    assert admits(prompt, "early", "R2", "R3")
    assert not admits(prompt, "early", "R2", "R3", "R4")
    assert admits(prompt, "late", "R2", "R3", "R4", "R5", "R6")


def test_who_has_a_narrow_link_can_only_send_what_it_carries() -> None:
    found = scene(
        candidate("E", range(20)),
        candidate("A", range(20, 30)),
        candidate("B", range(30, 40), capacity_bps=100_000.0),
    )
    prompt = asked(found)
    assert admits(prompt, "late", "A", "B")
    assert admits(prompt, "early", "A")
    assert not admits(prompt, "early", "B")


def test_the_rest_of_an_answer_is_bounded() -> None:
    prompt = asked(floor(6, KNOWN))
    everyone = prompt.candidates
    assert admits(prompt, "late", *everyone, confidence="high", explanation="x" * MAX_REASON)
    assert not admits(prompt, "late", *everyone, confidence="sure")
    assert not admits(prompt, "late", *everyone, confidence=0.5)
    assert not admits(prompt, "late", *everyone, explanation="x" * (MAX_REASON + 1))
    assert not admits(prompt, "late", *everyone, more="x")
    assert not Draft202012Validator(parsed(prompt)).is_valid({"algorithm": "late", "helpers": []})


def test_algorithms_under_the_same_rules_share_one_branch() -> None:
    loose = knowledge(q_min=0.1)
    assert "anyOf" not in parsed(asked(floor(6, loose, 1e9), loose))
    assert "anyOf" in parsed(asked(floor(6, loose, 25e6), loose))


def test_where_nobody_can_take_part_the_best_algorithm_stands_alone() -> None:
    prompt = asked(NOBODY)
    assert prompt.candidates == ()
    assert admits(prompt, "early")
    assert not admits(prompt, "late")


CANDIDATES = st.lists(
    st.tuples(
        st.sets(st.integers(0, 63), max_size=20),
        st.lists(st.floats(0, 1, width=32), min_size=4, max_size=4),
        st.dictionaries(st.sampled_from(ALGORITHMS), st.integers(1, 200_000), min_size=1),
        st.one_of(st.just(float("inf")), st.floats(1e3, 1e7)),
    ),
    max_size=20,
)


@settings(max_examples=100, deadline=None)
@given(CANDIDATES, st.floats(1.0, 1e8), st.sets(st.sampled_from(ALGORITHMS), min_size=1), st.data())
def test_whatever_the_schema_admits_is_accepted_or_repaired(
    others: list[Any], capacity_bps: float, algorithms: set[str], data: st.DataObject
) -> None:
    known = knowledge(sorted(algorithms))
    found = scene(
        candidate("E", range(10)),
        *(
            candidate(f"C{i}", sorted(cells), evidence, sizes=sizes, capacity_bps=own_bps)
            for i, (cells, evidence, sizes, own_bps) in enumerate(others)
        ),
        capacity_bps=capacity_bps,
    )
    prompt = asked(found, known)
    answer = sample(parsed(prompt), random.Random(data.draw(st.integers(0, 2**32))))
    assert Draft202012Validator(parsed(prompt)).is_valid(answer)
    advice = read_answer(json.dumps(answer), prompt)
    proposal = Proposal(advice.participants, advice.algorithm, advice.reason, "llm")
    decision = validate(proposal, found, known, policy="llm", cycle=1, now_ns=NOW_NS)
    assert isinstance(decision, Decision), decision
    assert_valid(decision, found, known)


@pytest.mark.model
@pytest.mark.parametrize("found", [NOBODY, floor(6, KNOWN, 25e6), floor(50, KNOWN, 25e6)])
def test_llama_cpp_makes_a_grammar_of_every_schema(found: UnifiedScene) -> None:
    llama_cpp = pytest.importorskip("llama_cpp", reason="llama-cpp-python is not installed")
    grammar = llama_cpp.LlamaGrammar.from_json_schema(asked(found).schema, verbose=False)
    assert "root ::=" in grammar._grammar
