"""Several intents at once: the newer wins where they contradict, and the older says so."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest

from ego_agent.plan.intents.combine import has_ended, is_in_force, standing
from swarm.messages import Focus, Intent, IntentInForce


def numbered(*intents: Intent) -> list[IntentInForce]:
    return [
        IntentInForce(number=number, intent=intent, operator="ann")
        for number, intent in enumerate(intents, 1)
    ]


def test_what_does_not_contradict_adds_up() -> None:
    found = standing(
        numbered(
            Intent(exclude=("A",), focus=(Focus("docks"),), q_min=0.8),
            Intent(exclude=("B",), focus=(Focus("hall", "low"),), link_share=0.5, prefer=("C",)),
        )
    )
    assert set(found.exclude) == {"A", "B"}
    assert {name: wished.value for name, wished in found.focus.items()} == {
        "docks": "high",
        "hall": "low",
    }
    assert (found.q_min and found.q_min.value, found.prefer) == (0.8, frozenset("C"))
    assert not found.overruled


@pytest.mark.parametrize(
    ("older", "newer", "said"),
    [
        (Intent(exclude=("A",)), Intent(prefer=("A",)), "leaving A out"),
        (Intent(exclude=("A",)), Intent(only=("A", "B")), "leaving A out"),
        (Intent(prefer=("A",)), Intent(exclude=("A",)), "preferring A"),
        (Intent(only=("A", "B")), Intent(exclude=("A",)), "asking A"),
        (Intent(only=("A",)), Intent(only=("B",)), "asking nobody but A"),
        (Intent(only=()), Intent(prefer=("B",)), "asking nobody but the ego"),
        (Intent(q_min=0.9), Intent(q_min=0.5), "its Q_min"),
        (Intent(link_share=0.9), Intent(link_share=0.5), "its share of the link"),
        (Intent(save="bandwidth"), Intent(save="compute"), "what it saves"),
        (Intent(policy="rules"), Intent(policy="coverage"), "its policy"),
        (Intent(focus=(Focus("docks"),)), Intent(focus=(Focus("docks", "low"),)), "docks"),
        (Intent(classes={"person": "low"}), Intent(classes={"person": "high"}), "person"),
    ],
)
def test_the_newer_wins_and_the_older_says_so(older: Intent, newer: Intent, said: str) -> None:
    found = standing(numbered(older, newer))
    ((number, sentences),) = found.overruled.items()
    assert number == 1
    assert len(sentences) == 1
    assert said in sentences[0]
    assert sentences[0].endswith("is overruled by wish 2 of ann")


def test_what_the_newer_wishes_is_what_counts() -> None:
    found = standing(numbered(Intent(exclude=("A",), q_min=0.9), Intent(only=("A",), q_min=0.5)))
    assert not found.exclude
    assert found.only is not None
    assert found.only.value == {"A"}
    assert found.q_min is not None
    assert found.q_min.value == 0.5


@pytest.mark.parametrize(
    ("given", "at", "in_force", "ended"),
    [
        ({}, "2027-01-15T12:00:00", True, False),
        ({"start": "2027-01-15T12:00:00+00:00"}, "2027-01-15T11:59:59", False, False),
        ({"start": "2027-01-15T12:00:00+00:00"}, "2027-01-15T12:00:00", True, False),
        ({"until": "2027-01-15T13:00:00+01:00"}, "2027-01-15T11:59:59", True, False),
        ({"until": "2027-01-15T13:00:00+01:00"}, "2027-01-15T12:00:00", False, True),
    ],
)
def test_an_intent_begins_and_ends_by_itself(
    given: dict[str, Any], at: str, in_force: bool, ended: bool
) -> None:
    one = IntentInForce(number=1, intent=Intent(q_min=0.5, **given))
    now_ns = int(datetime.fromisoformat(at).replace(tzinfo=UTC).timestamp()) * 10**9
    assert (is_in_force(one, now_ns), has_ended(one, now_ns)) == (in_force, ended)
