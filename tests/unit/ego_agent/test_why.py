"""Explanations hold what the journal holds, and nothing else."""

from __future__ import annotations

import json
import random
import re
from typing import Any

import msgspec
import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.journal import CycleRecord
from ego_agent.knowledge.why import explain, find
from ego_agent.knowledge.why.phrase import fault, known_names
from ego_agent.plan.policies.registry import make_policy
from ego_agent.settings import EgoSettings
from ego_agent.steering import Steering
from swarm.errors import JournalError
from swarm.log import make_logger
from swarm.messages import MIXED, Assignment, EgoSteering, EgoWish
from tests.support.why_journals import journal
from tests.support.why_truth import untrue

EXPLANATIONS, CYCLES = 1000, 8
FORMS = {
    "early": "points",
    "intermediate": "feature maps",
    "late": "boxes",
    "intermediate-codebook": "intermediate-codebook contributions",
}
OFTEN = {
    10.0: "10 times a second",
    2.5: "2.5 times a second",
    1.0: "once a second",
    0.5: "every 2 s",
}


def parsed(record: CycleRecord | None) -> Any:
    return None if record is None else json.loads(msgspec.json.encode(record))


def test_of_a_thousand_explanations_every_sentence_is_borne_out_by_the_journal() -> None:
    told = 0
    forms: set[str] = set()
    for seed in range(EXPLANATIONS // CYCLES):
        records = journal(random.Random(seed), CYCLES)
        for cycle in range(1, CYCLES + 1):
            found = find(records, cycle)
            sentences = explain(found).text().split("\n")
            lies = untrue(sentences, parsed(found.line), parsed(found.before), found.since)
            assert lies == [], (seed, cycle)
            told += 1
            forms |= {re.sub(r"\d+|R\d", "#", sentence)[:24] for sentence in sentences}
    assert told == EXPLANATIONS
    assert len(forms) > 40


def test_the_reader_of_these_tests_catches_planted_lies() -> None:
    rng, planted = random.Random(7), 0
    for seed in range(40):
        found = find(journal(random.Random(1000 + seed), CYCLES))
        line, before = parsed(found.line), parsed(found.before)
        sentences = explain(found).text().split("\n")
        for sentence in sentences:
            for lie in lies_of(sentence, sorted(line["inputs"]["robots"]), rng):
                if lie in sentences:
                    continue
                assert untrue([lie], line, before, found.since) == [lie], sentence
                planted += 1
    assert planted > 500


def lies_of(sentence: str, robots: list[str], rng: random.Random) -> list[str]:
    """The sentence with another number, another robot, the opposite, and something made up.

    A last digit that is off by one may be the same value, rounded the other way.
    """
    lies = [f"{sentence} Its battery is low.", sentence.rstrip(".") + ", as R99 says."]
    if numbers := list(re.finditer(r"(?<![\w.])\d+(?:\.\d+)?(?!\w)", sentence.split('"')[0])):
        one = rng.choice(numbers)
        digits = len(one.group().partition(".")[2])
        other = f"{float(one.group()) + rng.choice((2, 7)) * 10.0**-digits:.{digits}f}"
        lies.append(sentence[: one.start()] + other + sentence[one.end() :])
    if named := [robot for robot in robots if re.search(rf"\b{robot}\b", sentence.split('"')[0])]:
        one_of = rng.choice(named)
        others = [r for r in robots if not re.search(rf"\b{r}\b", sentence)]
        if others:
            lies.append(re.sub(rf"\b{one_of}\b", rng.choice(others), sentence, count=1))
        lies.append(re.sub(rf"\b{one_of}\b", "R98", sentence, count=1))
    for this, that in ((" is in: it adds", " is out: it adds"), (" is out: ", " is in: ")):
        if this in sentence:
            lies.append(sentence.replace(this, that))
    return lies


def test_the_cycle_must_be_in_the_journal() -> None:
    records = journal(random.Random(1), 4)
    assert find(records).line.cycle == 4
    with pytest.raises(JournalError, match="no cycle 9; allowed: 1 to 4"):
        find(records, 9)
    with pytest.raises(JournalError, match="holds no line yet"):
        find([])


def test_the_decision_before_is_the_last_of_another_choice() -> None:
    for seed in range(30):
        records = journal(random.Random(seed), CYCLES)
        found = find(records)
        choices = [
            (set(d.participants), d.algorithm, d.rate_hz) if len(d.participants) > 1 else ()
            for d in (record.decision for record in records)
        ]
        same = [choice == choices[-1] for choice in choices]
        last_other = max((i for i, equal in enumerate(same) if not equal), default=None)
        assert (found.before is None) == (last_other is None)
        assert found.since == (1 if last_other is None else last_other + 2)
        if found.before is not None and last_other is not None:
            assert found.before.cycle == last_other + 1


def test_a_line_of_an_older_program_says_what_it_lacks() -> None:
    record = journal(random.Random(3), 1)[0]
    raw = parsed(record)
    raw.pop("weighed")
    old = msgspec.json.decode(json.dumps(raw), type=CycleRecord)
    explanation = explain(find([old]))
    assert explanation.decision
    assert "does not say what robots add and cost" in explanation.lacks[0]
    assert explanation.otherwise == ()


def assigned(algorithm: str, *assignments: tuple[str, str, float]) -> CycleRecord:
    """A line whose robots send that, at 10 fused frames a second: robot, algorithm, rate in Hz."""
    record = journal(random.Random(3), 1)[0]
    decision = msgspec.structs.replace(
        record.decision,
        participants=("R1", *(robot for robot, _, _ in assignments)),
        algorithm=algorithm,
        rate_hz=10.0,
        assignments=tuple(
            Assignment(robot=robot, algorithm=form, rate_hz=hz) for robot, form, hz in assignments
        ),
    )
    return msgspec.structs.replace(record, decision=decision)


def sends(record: CycleRecord) -> list[str]:
    """The sentences about who sends what."""
    decision = explain(find([record])).decision
    return [sentence for sentence in decision if re.search(r"\w sends? ", sentence)]


def test_who_sends_what_and_how_often_is_told_where_it_differs() -> None:
    mixed = assigned(MIXED, ("R2", "early", 5.0), ("R10", "late", 2.0), ("R5", "early", 5.0))
    told = "R2 and R5 send points 5 times a second, R10 boxes 2 times a second."
    assert sends(mixed) == [told]
    assert told in explain(find([mixed])).text().split("\n")
    # One form for all, but some of them less often, or all.
    rarer = assigned("early", ("R2", "early", 10.0), ("R3", "early", 0.5))
    assert sends(rarer) == ["R2 sends points 10 times a second, R3 points every 2 s."]
    assert sends(assigned("late", ("R2", "late", 1.0))) == ["R2 sends boxes once a second."]


def test_who_is_asked_about_places_in_between_is_told() -> None:
    line = assigned("early", ("R2", "early", 10.0), ("R3", "early", 1.0))
    usual, rarer = line.decision.assignments
    rarer = msgspec.structs.replace(rarer, places_hz=5.0)
    decided = msgspec.structs.replace(line.decision, assignments=(usual, rarer))
    assert sends(msgspec.structs.replace(line, decision=decided)) == [
        "R2 sends points 10 times a second, R3 points once a second (5 times a second those of "
        "what is remembered)."
    ]
    objects = msgspec.structs.replace(rarer, objects_only=True)
    decided = msgspec.structs.replace(line.decision, assignments=(usual, objects))
    assert sends(msgspec.structs.replace(line, decision=decided)) == [
        "R2 sends points 10 times a second, R3 points of what may be an object once a second "
        "(5 times a second those of what is remembered)."
    ]


@pytest.mark.parametrize("assignments", [(), (("R2", "early", 10.0), ("R3", "early", 10.0))])
def test_nobody_is_told_of_where_all_send_the_same_in_every_frame(
    assignments: tuple[tuple[str, str, float], ...],
) -> None:
    assert sends(assigned("early", *assignments)) == []


@pytest.mark.parametrize("seed", range(50))
def test_what_is_told_of_assignments_is_all_that_the_line_holds(seed: int) -> None:
    rng = random.Random(seed)
    chosen = [(f"R{number}", rng.choice([*FORMS]), rng.choice([*OFTEN])) for number in range(2, 12)]
    (sentence,) = sends(assigned(MIXED, *chosen))
    forms, rates = ("|".join(map(re.escape, words.values())) for words in (FORMS, OFTEN))
    group = re.compile(rf"(R[\dR, and]*?) (?:sends? )?({forms}) ({rates})(?:, |\.$)")
    assert group.sub("", sentence) == ""
    found = {
        (robot, form, often)
        for robots, form, often in group.findall(sentence)
        for robot in re.split(r", | and ", robots)
    }
    assert found == {(robot, FORMS[form], OFTEN[hz]) for robot, form, hz in chosen}
    assert fault(sentence, explain(find([assigned(MIXED, *chosen)])), ()) == ""


def words_of(seed: int) -> tuple[Any, str, set[str]]:
    found = find(journal(random.Random(seed), CYCLES))
    explanation = explain(found)
    return explanation, explanation.text(), known_names(found)


@pytest.mark.parametrize("seed", range(20))
def test_a_phrasing_with_the_same_numbers_and_names_is_shown(seed: int) -> None:
    explanation, text, names = words_of(seed)
    assert fault(text, explanation, names) == ""
    assert fault("In short: " + " ".join(text.split("\n")), explanation, names) == ""


@pytest.mark.parametrize(
    "lie",
    ["It costs 123.456 kB.", "R99 takes part.", "Forty-two robots see it, and R97.", ""],
)
def test_a_phrasing_with_another_number_or_name_is_dropped(lie: str) -> None:
    explanation, text, names = words_of(5)
    assert fault(text + " " + lie if lie else "", explanation, names)


def test_a_robot_that_the_facts_do_not_name_may_not_stand_in_a_phrasing() -> None:
    explanation, _, names = words_of(5)
    assert "name no 'alpha'" in fault("alpha takes part.", explanation, names | {"alpha"})
    assert "in words" in fault("Seven robots take part.", explanation, names)


def test_an_ego_that_is_asked_tells_why_of_its_newest_line() -> None:
    known = Knowledge()
    steering = Steering(
        EgoSettings(ego="R1"), make_policy("coverage", known.algorithms), known, make_logger("ego")
    )
    assert steering.steer(EgoSteering(wish=EgoWish(), why=True)).why == ()
    records = journal(random.Random(9), 5)
    for record in records:
        steering.note(record)
    told = steering.steer(EgoSteering(wish=EgoWish(), why=True)).why
    assert list(told) == explain(find(records)).text().split("\n")
    assert steering.steer(EgoSteering(wish=EgoWish())).why == ()
