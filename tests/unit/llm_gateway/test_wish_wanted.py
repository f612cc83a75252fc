"""Parts of quality and of the link count only where words wish something of them."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    "R1, R2, R3, R4, R5, R6", "aisle 1, aisle 2, docks, racks", "person, forklift, pallet"
)


@pytest.mark.parametrize(
    "wish",
    [
        "forget the 50 percent limit on the link",
        "the link limit of 50 percent no longer applies",
        "stop limiting the link to 50 percent",
        "no need to keep 30 percent of the link free",
        "you needn't stay below half the link any more",
        "die Leitung muss nicht mehr auf 50 Prozent begrenzt sein",
        "die Grenze von 50 Prozent der Leitung gilt nicht mehr",
        "hört auf, 30 Prozent der Leitung freizuhalten",
        "forget about the minimum quality of 0.8",
        "we no longer need 80 percent quality",
        "quality doesn't have to be at least 0.8",
        "wir brauchen keine 80 Prozent Qualität",
        "Mindestqualität von 0,8 ist aufgehoben",
    ],
)
def test_a_bound_that_is_taken_back_is_asked_about(wish: str) -> None:
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "you may use more than half the link",
        "more than half the link is fine",
        "you are allowed to exceed 50 percent of the link",
        "ihr dürft mehr als die halbe Leitung nehmen",
    ],
)
def test_more_than_a_part_is_no_bound(wish: str) -> None:
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "the link is 30 percent used",
        "half the link is dead",
        "the link is down to 50 percent",
        "you're using half the link",
        "the swarm uses half the link",
        "die halbe Leitung ist ausgefallen",
        "die Auslastung der Leitung beträgt 50 Prozent",
        "30 Prozent der Leitung sind wieder frei",
        "each robot gets a third of the link",
        "no robot may take more than a third of the link",
        "we reached 80 percent quality",
        "quality is falling to 80 percent",
        "die Qualität sinkt auf 80 Prozent",
        "80 percent quality is unrealistic",
        "R2 only reaches 40 percent quality, leave it out",
        "R2 liefert nur 40 Prozent Qualität, weglassen",
        "ohne R3 fällt die Qualität auf 80 Prozent",
        "R2 kommt mit der halben Leitung aus",
    ],
)
def test_reports_bound_nothing(wish: str) -> None:
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    ("wish", "share"),
    [
        ("half the link", 0.5),
        ("nur noch 30 % Funk, bitte", 0.3),
        ("keep to half the link", 0.5),
        ("half the link is plenty", 0.5),
        ("die halbe Leitung muss reichen", 0.5),
        ("hold back 30 percent of the link", 0.7),
        ("keep 30 percent of the link open", 0.7),
        ("keep your hands off 30 percent of the link", 0.7),
        ("make sure 30 percent of the link is left", 0.7),
        ("verzichtet auf 30 Prozent der Leitung", 0.7),
    ],
)
def test_parts_of_the_link_are_bounds(wish: str, share: float) -> None:
    assert SITE.clear(wish).link_share == share


@pytest.mark.parametrize(
    "wish",
    [
        "quality 80 percent",
        "80 percent quality is enough",
        "quality must not drop below 0.8",
        "don't let quality drop under 80 percent",
        "keep quality at 0.8 or over",
        "mit 80 Prozent Qualität bin ich zufrieden",
        "Qualität nicht kleiner als 0,8",
        "Mindestqualität auf 0,8 setzen",
        "make sure we still get eighty percent quality at least",
    ],
)
def test_parts_of_quality_are_bounds(wish: str) -> None:
    assert SITE.clear(wish).q_min == 0.8
