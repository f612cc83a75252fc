"""Intents: only what can be obeyed is read, and what was read is written in the same form."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any

import pytest

from swarm.errors import MessageError
from swarm.messages import Focus, Intent, Site, intent_from_json, intent_to_json, problems

NOW = datetime.fromisoformat("2027-01-15T12:00:00+01:00")
SITE = Site(robots=("R1", "R3", "R5"), places=("docks", "Gang 3"), classes=("person",))
WHOLE: dict[str, Any] = {
    "exclude": ["R3"],
    "prefer": ["R5"],
    "only": None,
    "focus": [{"place": "docks", "weight": "high"}],
    "classes": {"person": "high"},
    "q_min": 0.8,
    "link_share": 0.5,
    "save": "bandwidth",
    "policy": None,
    "start": None,
    "until": "2027-01-15T18:00:00+01:00",
    "unclear": ["words"],
    "model": "smollm2",
    "elapsed_ms": 212.0,
}


def test_an_intent_is_written_as_it_was_read() -> None:
    intent = intent_from_json(json.dumps(WHOLE))
    assert json.loads(json.dumps(intent_to_json(intent))) == WHOLE
    assert intent_from_json(intent_to_json(intent)) == intent
    assert problems(intent, SITE, NOW) == ()


@pytest.mark.parametrize(
    "text", ["{}", '{"exclude": null, "focus": [], "classes": null, "unclear": ["hello?"]}']
)
def test_what_wishes_nothing_is_empty(text: str) -> None:
    intent = intent_from_json(text)
    assert intent.is_empty()
    assert not intent.is_hard()
    assert not intent.is_soft()


@pytest.mark.parametrize(
    ("wish", "hard"),
    [
        ({"exclude": ["R3"]}, True),
        ({"only": []}, True),
        ({"q_min": 0.0}, True),
        ({"link_share": 0.5}, True),
        ({"policy": "rules"}, True),
        ({"prefer": ["R3"]}, False),
        ({"focus": [{"place": "docks", "weight": "low"}]}, False),
        ({"classes": {"person": "low"}}, False),
        ({"save": "compute"}, False),
    ],
)
def test_every_wish_is_hard_or_soft(wish: dict[str, Any], hard: bool) -> None:
    intent = intent_from_json(wish)
    assert (intent.is_hard(), intent.is_soft()) == (hard, not hard)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ('["R3"]', "list"),
        ("{", "not a valid intent"),
        (b"\xff\xfe", "not a valid intent"),
        ({"leave": ["R3"]}, "'leave'"),
        ({"exclude": ["R3; drop"]}, "exclude"),
        ({"exclude": "R3"}, "exclude"),
        ({"only": ["R3\n"]}, "only"),
        ({"focus": [{"place": "docks", "weight": 3}]}, "weight"),
        ({"focus": [{"place": "do\ncks"}]}, "place"),
        ({"focus": [{"place": "docks\u202e"}]}, "place"),
        ({"focus": [{"place": "\x9b31mdocks"}]}, "place"),
        ({"classes": {"": "high"}}, "classes"),
        ({"q_min": 1.5}, "q_min"),
        ({"q_min": "0.8"}, "q_min"),
        ({"link_share": 0}, "link_share"),
        ({"save": "money"}, "save"),
        ({"policy": "a b"}, "policy"),
        ({"until": "at six"}, "'at six'"),
        ({"until": "2027-01-15T18:00:00"}, "no time zone"),
        (
            {"start": "2027-01-15T18:00:00+01:00", "until": "2027-01-15T17:00:00+00:00"},
            "not after start",
        ),
    ],
)
def test_what_cannot_be_obeyed_is_refused_and_named(given: Any, named: str) -> None:
    with pytest.raises(MessageError, match=named):
        intent_from_json(given)


@pytest.mark.parametrize(
    ("intent", "named"),
    [
        (Intent(exclude=("R9",)), "no robot 'R9'; known: R1, R3, R5"),
        (Intent(only=("R9",)), "no robot 'R9'"),
        (Intent(prefer=("R9",)), "no robot 'R9'"),
        (Intent(focus=(Focus("Hof"),)), "no place 'Hof'; known: docks, Gang 3"),
        (Intent(classes={"cat": "high"}), "no class 'cat'; known: person"),
        (Intent(exclude=("R3",), only=("R3",)), "'R3' is both"),
        (Intent(exclude=("R3",), prefer=("R3",)), "'R3' is both"),
        (Intent(prefer=("R3",), only=("R5",)), "not among the only"),
        (Intent(focus=(Focus("docks"), Focus("docks", "low"))), "'docks' has two weights"),
        (Intent(q_min=0.5, until="2027-01-15T11:59:59+01:00"), "is over"),
    ],
)
def test_what_a_site_does_not_have_and_what_contradicts_is_told(intent: Intent, named: str) -> None:
    found = problems(intent, SITE, NOW)
    assert len(found) == 1
    assert named in found[0]


@pytest.mark.parametrize("name", ["Gang 3", "Süd-Rampe", "倉庫", "склад №2", "1' OR '1'='1", "<b>"])
def test_a_place_has_a_name_in_any_alphabet(name: str) -> None:
    intent = intent_from_json({"focus": [{"place": name}]})
    assert intent.focus == (Focus(name, "high"),)
    assert problems(intent, Site(places=(name,)), NOW) == ()


def test_the_end_counts_in_its_own_time_zone() -> None:
    assert problems(Intent(q_min=0.5, until="2027-01-15T11:30:00+00:00"), SITE, NOW) == ()
