"""The short prompt: what it tells, what may be answered, and how answers are read."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import pytest

from ego_agent.knowledge.answers import AnswerTimes, Pool, Weighted
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import RARER_HZ, SLOWER_HZ
from ego_agent.plan.advice.judge import Advised, repaired
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting import LlmPrompt, read_answer
from ego_agent.plan.prompting.short import MAX_LETTERS, make_short_prompt, short_scene
from llm_gateway.answers import extract
from llm_gateway.backends.llamacpp.schema import grammar_of
from llm_gateway.schemas import Schemas
from swarm.errors import DecisionError
from swarm.messages import MIXED
from tests.support.prompt_scenes import floor, text, tokens, user

ALL = ("early", "intermediate", "late")
RATES_BPS = (0.1e6, 1e6, 5e6, 20e6, 200e6)
MARKUP_TOKENS = 14
"""Of SmolLM2's chat format around a system's and a user's message."""
__all__ = ["tokens"]


def live() -> Knowledge:
    """As an ego of a swarm in the factory."""
    return Knowledge.of_detector("factory", Objective(slower_hz=SLOWER_HZ, rarer_hz=RARER_HZ), ALL)


def short(found: UnifiedScene, known: Knowledge | None = None) -> LlmPrompt:
    return make_short_prompt(found, known or live(), None, None)


def late(found: UnifiedScene) -> UnifiedScene:
    """The scene with robots whose points hardly ever come in time."""
    slow = {"early": AnswerTimes(own=Pool.of([Weighted(0.6, 9.5, 9.5)]), frames=9.5)}
    return replace(found, candidates=tuple(replace(c, answers=slow) for c in found.candidates))


def answers(prompt: LlmPrompt) -> list[str]:
    found: list[str] = json.loads(prompt.schema)["enum"]
    return found


def test_six_robots_take_at_most_120_tokens_and_their_answers_12(
    tokens: Callable[[str], list[int]],
) -> None:
    for robots in (3, 7):
        for rate_bps in RATES_BPS:
            found = floor(robots, live(), rate_bps)
            assert len(tokens(text(short(late(found))))) + MARKUP_TOKENS <= 120
            prompt = short(found)
            assert len(tokens(text(prompt))) + MARKUP_TOKENS <= 120
            for answer in answers(prompt):
                assert len(tokens(json.dumps(answer))) <= 12


def test_it_ends_with_the_link_and_begins_with_what_the_link_does_not_change() -> None:
    narrow, wide = (user(short(floor(4, live(), rate))).split("\n") for rate in (20e6, 200e6))
    assert narrow[-1] == "link 180"
    assert wide[-1] == "link 1800"
    assert narrow[0].startswith("ego ")


def test_what_is_seen_adds_up() -> None:
    found = floor(6, live(), 20e6)
    told = short_scene(Scorer(found, live()))
    row_of = Scorer(found, live()).row_of
    rows = [0, *(row_of[robot] for robot in told.robots)]
    shares = [Scorer(found, live()).share(rows[: k + 1]) for k in range(len(rows))]
    assert told.seen == pytest.approx([100 * min(live().quality.enough, s) for s in shares])
    words = user(short(found)).split("\n")[0].split()
    assert float(words[1]) == pytest.approx(told.seen[0], abs=0.5)
    for word, letter, adds in zip(words[2:], "ABCDE", told.adds, strict=True):
        assert word[0] == letter
        assert float(word[1:]) == pytest.approx(adds, abs=0.05 if adds < 9.95 else 0.5)


def test_every_answer_is_carried_by_the_link_and_what_coverage_chooses_is_among_them() -> None:
    for rate_bps in RATES_BPS:
        for robots in (1, 2, 4, 7):
            found, known = floor(robots, live(), rate_bps), live()
            scorer = Scorer(found, known)
            prompt = make_short_prompt(found, known, None, None, scorer=scorer)
            best, _ = Coverage().choose(scorer, None)
            wanted = {robot: best.algorithm_of(robot) for robot in best.participants}
            choices = []
            for answer in answers(prompt):
                advice = read_answer(json.dumps(answer), prompt)
                sends = dict.fromkeys(advice.participants[1:], advice.algorithm)
                sends |= advice.forms
                what = Advised(advice.participants, advice.algorithm, advice.forms)
                verdict = repaired(what, scorer)
                assert verdict.refused is None
                if sends == wanted and verdict.score is not None:
                    assert verdict.repaired == ()
                    assert verdict.score.value == pytest.approx(best.value, abs=0.005)
                choices.append(sends)
            assert wanted in choices


def test_answers_reach_q_min_where_any_does() -> None:
    found = floor(5, live(), 20e6)
    for q_min in (0.0, 0.6, 0.7, 1.0):
        known = Knowledge.of_detector("factory", Objective(q_min=q_min), ALL)
        scorer = Scorer(found, known)
        prompt = short(found, known)
        scores = []
        for answer in answers(prompt):
            advice = read_answer(json.dumps(answer), prompt)
            scores.append(scorer.good_enough(scorer.score(advice.participants, advice.algorithm)))
        assert all(scores) == (q_min < 1.0)
        assert ("too little" in user(prompt)) == (q_min == 1.0)


def test_answers_pass_the_gateway_and_only_those_that_are_offered() -> None:
    prompt = short(floor(4, live(), 20e6))
    for answer in answers(prompt):
        assert json.loads(extract(json.dumps(answer), prompt.schema, Schemas())) == answer
        assert json.dumps(json.dumps(answer)) in grammar_of(prompt.schema)


def test_each_algorithm_is_that_of_the_letters_behind_it() -> None:
    prompt = short(floor(4, live(), 20e6))
    first, second, third = prompt.candidates[:3]
    advice = read_answer('"early A B late C"', prompt)
    assert advice.participants == ("R1", first, second, third)
    assert advice.algorithm == MIXED
    assert advice.forms == {first: "early", second: "early", third: "late"}
    twice = read_answer('"early A late A"', prompt)
    assert (twice.participants, twice.algorithm) == (("R1", first), "early")


def test_letters_are_the_robots_of_the_prompt() -> None:
    prompt = short(floor(4, live(), 20e6))
    advice = read_answer('"early A C"', prompt)
    assert advice.participants == ("R1", prompt.candidates[0], prompt.candidates[2])
    assert (advice.algorithm, advice.reason, advice.confidence) == ("early", "", 1.0)
    alone = read_answer('"alone"', prompt)
    assert alone.participants == ("R1",)
    assert alone.algorithm == "early"


@pytest.mark.parametrize(
    ("said", "named"),
    [("[]", "not text"), ('"early Z"', "'Z'"), ("early A", "no JSON"), ('"early  A"', "''")],
)
def test_what_is_no_answer_in_letters_is_refused(said: str, named: str) -> None:
    with pytest.raises(DecisionError, match=named):
        read_answer(said, short(floor(4, live(), 20e6)))


def test_late_answers_are_told_only_where_there_are_any() -> None:
    found = floor(4, live(), 20e6)
    assert "time" not in user(short(found))
    rows = [line.split() for line in user(short(late(found))).split("\n")]
    assert rows[1] == ["price", "time", "kB", "fit"]
    assert {row[0]: row[2] for row in rows[2:5]} == {
        "early": "5",
        "intermediate": "100",
        "late": "100",
    }


def test_many_robots_get_letters_up_to_a_limit() -> None:
    prompt = short(floor(30, live(), 200e6))
    assert len(prompt.candidates) == MAX_LETTERS


def test_another_order_of_letters_has_another_fingerprint() -> None:
    found = floor(5, live(), 20e6)
    narrow = short(floor(5, live(), 1e6))
    assert short(found).fingerprint == short(found).fingerprint
    assert short(found).fingerprint != narrow.fingerprint


def test_an_ego_that_nobody_can_help_is_offered_to_stay_alone() -> None:
    assert answers(short(floor(1, live()))) == ["alone"]
