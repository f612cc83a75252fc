"""Short forms beside numbers, and parts of the link that belong to others."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    robots="R1, R2, R3, lark-a, lark-b",
    places="docks, ramp",
    classes="person, box",
)
understood = SITE.understood


@pytest.mark.parametrize(
    ("wish", "part"),
    [
        ("quality 0.8 min.", 0.8),
        ("Q 0,75 min, R2 weg", 0.75),
        ("Qualität 0,8 mind. R2 weg", 0.8),
        ("quality min. 0.9. R2 out", 0.9),
        ("Mindestqualitt 0,85, also 0,85", 0.85),
    ],
)
def test_min_beside_a_decimal_is_a_bound(wish: str, part: float) -> None:
    intent = understood(wish)
    assert (intent.q_min, intent.until, intent.unclear) == (part, None, ())


@pytest.mark.parametrize("wish", ["R2 out, quality 80 min", "R2 weg, Qualität bei 80 min"])
def test_min_behind_a_whole_number_of_quality_is_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.until, intent.q_min) == (("R2",), None, None)
    assert intent.unclear


@pytest.mark.parametrize(
    ("wish", "until"),
    [
        ("R2 out 30 min, quality 0.8", "14:35:00"),
        ("R2 out for 0.5 min", "14:05:30"),
        ("R2 weg, mind. 30 min", "14:35:00"),
        ("quality 0.8 for 90 min. R2 out", "15:35:00"),
    ],
)
def test_min_behind_a_length_of_time_is_minutes(wish: str, until: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.unclear) == (("R2",), ())
    assert intent.until == f"2026-11-23T{until}+01:00"


def test_a_full_stop_behind_a_short_form_ends_a_sentence_where_no_number_follows() -> None:
    assert understood("R2 out. Never mind. Watch the docks").unclear == ()
    intent = understood("use 0.4 of the link max. Ask R2 first")
    assert (intent.link_share, intent.prefer, intent.unclear) == (0.4, ("R2",), ())


@pytest.mark.parametrize(
    ("wish", "share"),
    [
        ("Lasst dem Gäste-WLAN 60 Prozent vom Netz übrig", 0.4),
        ("Überlasst den Kassen ein Viertel der Bandbreite", 0.75),
        ("gönnt dem Besucher-WLAN 30 Prozent vom Netz", 0.7),
        ("give the visitors' wifi 60 percent of the bandwidth", 0.4),
        ("set aside 40 percent of the link for the tills", 0.6),
        ("Haltet 70 Prozent vom Netz für die Ärzte zurück", 0.3),
        ("für die Kassen bleiben 70 Prozent vom Netz", 0.3),
        ("40 percent of the link stays with the guests", 0.6),
        ("Gebt dem Schwarm 40 Prozent vom Netz", 0.4),
        ("hold the link at 40 percent for the cameras", 0.4),
    ],
)
def test_a_part_that_others_are_given_is_kept_free(wish: str, share: float) -> None:
    intent = understood(wish)
    assert (intent.link_share, intent.unclear) == (share, ())


@pytest.mark.parametrize(
    "wish",
    [
        "Gebt den Kassen höchstens die Hälfte vom Netz",
        "Nehmt die Hälfte vom Netz für die Reisenden",
        "leave the link at 40 percent",
        "reserve 40 percent of the link for the swarm",
    ],
)
def test_whose_part_it_is_is_asked_where_words_do_not_say(wish: str) -> None:
    intent = understood(wish)
    assert intent.link_share is None
    assert intent.unclear
