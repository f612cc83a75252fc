"""What looks like a reason, a state or an exception, and may be a wish of its own."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    robots="R1, R2, R3, R5, R20, R22",
    places="docks, ramp, hall 3",
    classes="person, box, pallet",
)
understood, clear, weights = SITE.understood, SITE.clear, SITE.weights


@pytest.mark.parametrize(
    "wish",
    [
        "Nobody may ask R2 but R5.",
        "Nobody may ask R2, except R5",
        "Nobody is to ask R2, only R5",
        "Nobody may ask R2. But R5 may.",
        "No one must contact R2 (but R5)",
        "Don't ask R2 but R5",
        "R2 darf niemand fragen, außer R5",
        "R2 darf niemand fragen, aber R5 schon",
        "R2 soll keiner fragen, bloß R5",
        "R2 darf keiner stören, jedoch R5",
        "R2 soll niemand fragen, R5 ausgenommen",
        "R2 soll keiner nutzen, sondern R5",
        "Fragt R2 nicht, aber R5",
    ],
)
def test_who_is_excepted_is_not_left_out_as_well(wish: str) -> None:
    intent = understood(wish)
    assert {"R2", "R5"} <= {*intent.unclear}
    assert intent.is_empty()


@pytest.mark.parametrize(
    "wish", ["Skip R2 but not R5", "R2 raus, nicht R5", "R2 weglassen, aber nicht R5"]
)
def test_who_is_not_left_out_is_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.unclear) == (("R2",), ("R5",))


def test_what_names_no_other_robot_excepts_none() -> None:
    assert clear("Nobody may ask R2, but the docks matter").exclude == ("R2",)
    assert clear("Nobody may ask R2 and R5").exclude == ("R2", "R5")
    assert clear("Don't ask R2 but ask R5 first").prefer == ("R5",)
    assert clear("Don't ask R2, only R5").only == ("R5",)


@pytest.mark.parametrize(
    "wish",
    [
        "Only R2, R3 is free too",
        "Only R2, R3 is available as well",
        "Only R2, R3 is ready",
        "Only R2, R3 is fixed now",
        "Nur R2, R3 ist auch dabei",
        "Nur R2, R3 ist ebenfalls in Ordnung",
        "Nur R2, R3 ist wieder da",
    ],
)
def test_who_may_help_as_well_is_asked_back(wish: str) -> None:
    assert "R3" in understood(wish).unclear


@pytest.mark.parametrize("wish", ["Only R2, R3 is charging", "Nur R2, R3 ist kaputt"])
def test_who_is_ailing_is_not(wish: str) -> None:
    assert clear(wish).only == ("R2",)


@pytest.mark.parametrize(
    "wish",
    [
        "R2 first, it works best in hall 3",
        "R2 first, it is needed in hall 3",
        "R2 first, it's in charge of hall 3",
        "R2 zuerst, er arbeitet am besten in hall 3",
        "R2 zuerst, er hilft in hall 3",
        "R2 zuerst, er ist gut in hall 3",
        "R2 zuerst, er ist in hall 3 am besten",
        "R2 zuerst, er steht in hall 3 goldrichtig",
    ],
)
def test_where_a_robot_does_well_is_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert (intent.prefer, intent.unclear) == (("R2",), ("hall 3",))


def test_where_a_robot_stands_is_not() -> None:
    assert clear("R2 first, it stands right next to hall 3").prefer == ("R2",)
    assert clear("R2 zuerst, er steht an der ramp").prefer == ("R2",)


@pytest.mark.parametrize(
    "wish",
    [
        "R2 out, we're hunting pallets",
        "R2 out, we're after pallets",
        "R2 out, we're moving in on pallets",
        "R2 out, somebody is hunting pallets",
        "at most half the link, we're hunting pallets",
        "R2 raus, wir jagen pallets",
        "R2 raus, man sucht pallets",
    ],
)
def test_what_one_may_look_for_is_asked_back(wish: str) -> None:
    assert "pallets" in understood(wish).unclear


def test_what_one_works_at_is_not() -> None:
    assert clear("R2 out, we're loading two pallets").exclude == ("R2",)
    assert clear("R2 raus, wir verladen pallets").exclude == ("R2",)


@pytest.mark.parametrize(
    "wish",
    [
        "Only R2 while the link is above 50 percent",
        "Only R2 as long as the link is above 50 percent",
        "Only R2 provided the link is above 50 percent",
        "The link is above 50 percent, only R2",
        "Only R2 while quality is above 0.8",
        "R2 first while quality stays above 0.8",
        "Nur R2, solange der Link über 50 Prozent liegt",
        "Nur R2, während der Link über 50 % ist",
        "Nur R2 bei über 50 Prozent Link",
        "Nur R2, solange die Güte über 0,8 liegt",
    ],
)
def test_how_much_something_is_bounds_nothing(wish: str) -> None:
    intent = understood(wish)
    assert (intent.link_share, intent.q_min) == (None, None)
    assert intent.unclear


def test_a_bound_may_hold_for_a_while() -> None:
    assert clear("While it's raining use at most 30 % of the link").link_share == 0.3
    assert clear("Keep quality at 0.8 while the link is slow").q_min == 0.8
    assert clear("don't go over 30 % of the link").link_share == 0.3


@pytest.mark.parametrize(
    "wish",
    [
        "Don't lose your focus on the docks",
        "Never lose focus on the docks",
        "Don't take your eyes off the docks",
        "Don't let your attention slip at the docks",
        "Verliert den Fokus auf die docks nicht",
        "Lasst die Aufmerksamkeit an den docks nicht nachlassen",
    ],
)
def test_what_one_must_not_lose_sight_of_counts(wish: str) -> None:
    assert weights(wish) == {"docks": "high"}


def test_what_one_may_lose_sight_of_is_asked_back() -> None:
    assert weights("Don't pay attention to dropped boxes") == {"box": "low"}
    assert understood("We may lose focus on the docks").unclear == ("docks",)
    assert understood("No worry about losing focus on the docks").is_empty()


@pytest.mark.parametrize(
    "wish",
    [
        "Roboter zwei und zwanzig weglassen",
        "nur Roboter Nummer zwei und zwanzig",
        "Roboter zwei- und zwanzig raus",
        "R zwei und zwanzig raus",
        "Halle drei und zwanzig ist wichtig",
    ],
)
def test_a_number_said_apart_may_be_one(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert intent.is_empty()


def test_numbers_in_a_list_are_several() -> None:
    assert clear("Roboter 2 und 20 weglassen").exclude == ("R2", "R20")
    assert clear("robots two and twenty out").exclude == ("R2", "R20")


@pytest.mark.parametrize(
    "wish",
    [
        "Watch the docks. Nobody may enter.",
        "Watch the docks, no one is allowed in",
        "Watch the docks. Nobody should go in there.",
        "Achtet auf die docks. Niemand darf rein.",
        "docks wichtig. Da soll keiner rein.",
    ],
)
def test_what_is_forbidden_besides_is_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert [f.weight for f in intent.focus] == ["high"]
    assert intent.unclear


@pytest.mark.parametrize(
    ("wish", "policy"),
    [
        ("Surrogate, not coverage.", "surrogate"),
        ("Not coverage but surrogate.", "surrogate"),
        ("Not coverage, rules.", "rules"),
        ("surrogate not coverage", "surrogate"),
        ("Surrogate, nicht coverage.", "surrogate"),
        ("Nicht coverage, sondern surrogate.", "surrogate"),
        ("Kein coverage, sondern rules", "rules"),
        ("Nicht surrogate, sondern coverage", "coverage"),
    ],
)
def test_one_policy_and_not_another(wish: str, policy: str) -> None:
    assert clear(wish).policy == policy


@pytest.mark.parametrize(
    ("wish", "unread"),
    [
        ("R2 out for 5 m", "5 m"),
        ("R2 out in 5 s", "5 s"),
        ("R2 out, another 10 m", "10 m"),
        ("R2 raus für 5 m", "5 m"),
        ("R2 raus, noch 5 m", "5 m"),
    ],
)
def test_a_length_without_a_plain_unit_is_asked_back(wish: str, unread: str) -> None:
    assert unread in understood(wish).unclear
