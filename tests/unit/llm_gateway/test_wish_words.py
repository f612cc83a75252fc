"""What operators of both languages say in other words, other orders and with their reasons."""

from __future__ import annotations

from datetime import datetime

import pytest

from llm_gateway.wishes import understand
from swarm.messages.intent import Intent, Site

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")
SITE = Site(
    robots=("R1", "R2", "R3", "R4", "R5", "R6"),
    places=("docks", "aisle 1", "aisle 2", "ramp", "Tor 4"),
    classes=("person", "box", "forklift", "wheelchair"),
)


def understood(wish: str) -> Intent:
    return understand(wish, SITE, NOW, None)


def weights(wish: str) -> dict[str, str]:
    intent = understood(wish)
    assert intent.unclear == ()
    return {**{f.place: f.weight for f in intent.focus}, **intent.classes}


@pytest.mark.parametrize(
    "wish",
    [
        "people near the loading bay matter most",
        "people near the lodaing bays matter most",
        "Personen bei der Laderampe sind am wichtigsten",
        "people at dock 7 matter most",
    ],
)
def test_a_place_has_the_words_that_its_site_knows(wish: str) -> None:
    words = {"dock 7": ("loading bay", "Laderampe"), "moon": ("docks",)}
    site = Site(robots=("R1",), places=("dock 7", "ramp"), classes=("person",), words=words)
    intent = understand(wish, site, NOW, None)
    assert {focus.place: focus.weight for focus in intent.focus} == {"dock 7": "high"}
    assert intent.classes == {"person": "high"}
    assert intent.unclear == ()


@pytest.mark.parametrize(
    ("wish", "saved"),
    [
        ("go easy on the wifi", "bandwidth"),
        ("ease off the uplink", "bandwidth"),
        ("quit hammering the network", "bandwidth"),
        ("don't clog the link", "bandwidth"),
        ("take some load off the processors", "compute"),
        ("the uplink is choking, send less data", "bandwidth"),
        ("bitte das WLAN schonen", "bandwidth"),
        ("den Bordrechner nicht so belasten", "compute"),
        ("das Funknetz entlasten", "bandwidth"),
    ],
)
def test_many_words_say_save(wish: str, saved: str) -> None:
    intent = understood(wish)
    assert (intent.save, intent.unclear) == (saved, ())


@pytest.mark.parametrize(
    "wish",
    [
        "ground R2 and R3",
        "R2 and R3 are grounded",
        "R2 adn R3 can sleep",
        "park R2, R3",
        "make do without R2 and R3",
        "r two and r three are off duty",
        "robot two and robot three stay home",
        "R2 has a loose wheel and R3 a cracked lens; do without the pair of them",
        "nix mit R2 und R3",
        "R2 und R3 bitte nicht einplanen",
        "R2 und R3 sollen ausgelassen werden",
        "ich will R2 und R3 nicht dabei haben",
    ],
)
def test_many_words_leave_robots_out_and_lists_share_them(wish: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.only, intent.unclear) == (("R2", "R3"), None, ())


@pytest.mark.parametrize(
    ("wish", "meant"),
    [
        ("watch the docks, the ramp doesn't matter", {"docks": "high", "ramp": "low"}),
        ("mind the people, boxes I don't care about", {"person": "high", "box": "low"}),
        ("people matter, boxes don't", {"person": "high", "box": "low"}),
        ("watch the docks, the ramp and aisle 1",
         {"docks": "high", "ramp": "high", "aisle 1": "high"}),
        ("the docks, the ramp are important", dict.fromkeys(("docks", "ramp"), "high")),
        ("never mind the ramp, but the docks, that's where I want sharp eyes",
         {"ramp": "low", "docks": "high"}),
        ("aisles 1 and 2 are hot", {"aisle 1": "high", "aisle 2": "high"}),
        ("look harder at aisle two", {"aisle 2": "high"}),
        ("Rollstühle gehen vor", {"wheelchair": "high"}),
        ("forklifts! watch the damn forklifts!", {"forklift": "high"}),
        ("the ramp please, and people above all", {"ramp": "high", "person": "high"}),
    ],
)  # fmt: skip
def test_what_follows_a_name_may_be_a_clause_of_its_own(wish: str, meant: dict[str, str]) -> None:
    assert weights(wish) == meant


@pytest.mark.parametrize(
    "wish",
    [
        "take R2 where you can",
        "am liebsten R2, wenn's geht",
        "lean on R2",
        "R2 has the new sensor, so ask R2 first",
        "prefer R2 over the rest",
    ],
)
def test_many_words_prefer(wish: str) -> None:
    intent = understood(wish)
    assert (intent.prefer, intent.unclear) == (("R2",), ())


def test_a_reason_is_no_wish_and_needs_a_wish_beside_it() -> None:
    intent = understood("As the ramp was hosed down, pay attention to it until four")
    assert [(f.place, f.weight) for f in intent.focus] == [("ramp", "high")]
    assert intent.unclear == ()
    assert understood("The ramp was hosed down, leave R2 out").unclear
    assert understood("R3 was hit, use R2 first").unclear


def test_a_number_in_words_is_only_a_number_of_the_site() -> None:
    assert understood("leave r nine out").is_empty()
    assert understood("Gang achte auf Menschen").focus == ()
