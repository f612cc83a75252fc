"""The hand-written wishes, and how an answer to them is counted."""

from __future__ import annotations

from collections import Counter

import msgspec
import pytest

from llm_gateway.wishes import understand
from research.evaluation.wishes.score import at_most, score, summary
from research.evaluation.wishes.ways import RandomReader, checked, unchecked
from research.training.wishes.cases import WISHES, Case, cases
from swarm.messages.intent import Focus, Intent, problems


@pytest.fixture(scope="module")
def written() -> list[Case]:
    return cases()


def test_there_are_enough_of_each_kind(written: list[Case]) -> None:
    assert len({case.id for case in written}) == len(written) >= 300
    kinds = Counter(case.kind for case in written)
    assert sum(count for kind, count in kinds.items() if kind != "wish") >= 60
    assert Counter(case.language for case in written)["de"] >= 100


@pytest.mark.parametrize(
    "name", ["wishes", "wishes-accepted", "wishes-apart", "wishes-taught", "wishes-traps"]
)
def test_every_meant_intent_can_be_obeyed(name: str) -> None:
    asked = cases(WISHES.with_name(f"{name}.jsonl"))
    assert len({case.id for case in asked}) == len(asked)
    for case in asked:
        assert problems(case.meant, case.site, case.time) == (), case.id
        assert not case.meant.is_empty() or case.doubtful, case.id


@pytest.mark.parametrize(
    "name", ["wishes", "wishes-accepted", "wishes-fresh", "wishes-held-out", "wishes-learnt"]
)
def test_words_alone_misread_nothing_hard_in_any_set(name: str) -> None:
    asked = cases(WISHES.with_name(f"{name}.jsonl"))
    scores = [score(case, understand(case.wish, case.site, case.time, None)) for case in asked]
    assert [case.id for case, one in zip(asked, scores, strict=True) if one.unsafe] == []
    assert sum(one.confident for one in scores) <= 0.025 * len(asked)


def test_what_is_meant_is_exact_and_changes_are_not(written: list[Case]) -> None:
    case = next(case for case in written if case.id == "en-001")
    meant = case.meant
    right = score(case, meant)
    assert (right.exact, right.unsafe, right.confident) == (True, False, False)
    hard = msgspec.structs.replace(meant, exclude=("R4",))
    assert score(case, hard).unsafe
    asked = score(case, msgspec.structs.replace(hard, unclear=("R4",)))
    assert (asked.exact, asked.unsafe, asked.confident) == (False, False, False)
    soft = score(case, msgspec.structs.replace(meant, focus=(Focus("docks", "low"),)))
    assert (soft.exact, soft.unsafe, soft.confident) == (False, False, True)
    later = msgspec.structs.replace(meant, until="2026-11-23T17:00:00+00:00")
    assert score(case, later).exact


def test_a_confident_answer_to_no_wish_is_counted(written: list[Case]) -> None:
    case = next(case for case in written if case.kind == "no wish")
    assert score(case, Intent(unclear=("?",))).exact
    assert score(case, Intent()).confident
    assert score(case, Intent(exclude=("R1",))).unsafe


@pytest.mark.parametrize(
    ("hits", "tries", "bound"), [(0, 300, 0.00994), (1, 100, 0.0466), (227, 3575, 0.0706)]
)
def test_the_bound_is_that_of_clopper_and_pearson(hits: int, tries: int, bound: float) -> None:
    assert at_most(hits, tries) == pytest.approx(bound, abs=2e-4)
    assert at_most(5, 5) == 1.0


def test_plain_words_of_other_people_are_mostly_read(written: list[Case]) -> None:
    scores = [score(case, checked(None)(case)) for case in written]
    row = summary(written, scores)
    assert (row["exact"] or 0) > 0.85
    assert (row["wrong_and_confident"] or 0) < 0.03


def test_a_random_model_is_caught(written: list[Case]) -> None:
    some = written[::4]
    held = summary(some, [score(case, checked(RandomReader(1))(case)) for case in some])
    alone = summary(some, [score(case, unchecked(RandomReader(1))(case)) for case in some])
    assert (held["unsafe"] or 0) < (alone["unsafe"] or 0)
