from __future__ import annotations

import json
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.plan.prompting import Advice, make_prompt, read_answer
from swarm.errors import DecisionError
from tests.support.ego_scenes import knowledge
from tests.support.prompt_scenes import floor

PROMPT = make_prompt(floor(6, knowledge()), knowledge(), None, None)
GOOD: dict[str, Any] = {
    "algorithm": "late",
    "helpers": ["R3", "R2"],
    "confidence": "high",
    "explanation": "wide view",
}


def test_an_answer_is_advice_with_the_ego_first() -> None:
    advice = read_answer(json.dumps(GOOD), PROMPT)
    assert advice == Advice(("R1", "R3", "R2"), "late", "wide view", 0.8)


@pytest.mark.parametrize(("said", "counts"), [("low", 0.2), ("medium", 0.5), (75, 0.75), (0, 0)])
def test_confidence_is_a_word_or_a_number(said: object, counts: float) -> None:
    assert read_answer(json.dumps(GOOD | {"confidence": said}), PROMPT).confidence == counts


@pytest.mark.parametrize("helpers", [["R3", "R3", "R2"], ["R1", "R3", "R2"], ["R3", "R2", "R1"]])
def test_duplicates_and_the_ego_itself_are_removed(helpers: list[str]) -> None:
    advice = read_answer(json.dumps(GOOD | {"helpers": helpers}), PROMPT)
    assert advice.participants == ("R1", "R3", "R2")


def test_robots_that_are_not_there_are_left_to_be_judged() -> None:
    advice = read_answer(json.dumps(GOOD | {"helpers": ["ghost"]}), PROMPT)
    assert advice.participants == ("R1", "ghost")


def test_more_than_was_asked_for_does_not_matter() -> None:
    assert read_answer(json.dumps(GOOD | {"notes": [1]}), PROMPT).algorithm == "late"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no JSON"),
        ('{"algorithm":"late","helpers":["R3"', "no JSON"),
        ("[" * 5_000, "no JSON"),
        (json.dumps(GOOD | {"confidence": float("nan")}), "NaN is no JSON number"),
        ('"late"', "the answer is 'late', not an object"),
        ("[]", "of type list, not an object"),
        (json.dumps({k: v for k, v in GOOD.items() if k != "helpers"}), "no helpers"),
        (json.dumps({k: v for k, v in GOOD.items() if k != "explanation"}), "no explanation"),
        (json.dumps(GOOD | {"helpers": "R3"}), "helpers are not a list of robot ids"),
        (json.dumps(GOOD | {"helpers": [3]}), "helpers are not a list of robot ids"),
        (json.dumps(GOOD | {"helpers": ["x"] * 2_000}), "2000 helpers, at most 1024"),
        (json.dumps(GOOD | {"algorithm": None}), "algorithm is of type NoneType, not text"),
        (json.dumps(GOOD | {"confidence": "sure"}), "is 'sure'; allowed: low, medium, high"),
        (json.dumps(GOOD | {"confidence": True}), "confidence is True; allowed"),
        (json.dumps(GOOD | {"confidence": []}), "confidence is of type list; allowed"),
        (json.dumps(GOOD | {"confidence": 101}), "confidence is 101; allowed"),
        (json.dumps(GOOD).replace('"high"', "1e999"), "confidence is inf; allowed"),
        (" " * 100_001, "100001 characters, at most 100000"),
    ],
)
def test_an_answer_of_another_form_is_refused_with_what_is_wrong(text: str, why: str) -> None:
    with pytest.raises(DecisionError, match=re.escape(why)):
        read_answer(text, PROMPT)


@given(
    st.one_of(
        st.text(),
        st.recursive(
            st.none() | st.booleans() | st.floats() | st.text(),
            lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from([*GOOD]), inner),
        ).map(json.dumps),
    )
)
def test_no_answer_does_worse_than_being_refused(text: str) -> None:
    try:
        advice = read_answer(text, PROMPT)
    except DecisionError:
        return
    assert advice.participants[0] == "R1"
    assert 0.0 <= advice.confidence <= 1.0
