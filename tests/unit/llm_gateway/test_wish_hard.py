"""A second hard clause about the same robots ends in the intent, or is asked back."""

from __future__ import annotations

import random

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    robots="R1, R2, R3, R5", places="docks, aisle 5, ramp", classes="person, pallet, chair"
)
WANTED = {
    "en": (
        "Ask nobody but {}", "Ask only {}", "Nobody except {} may be asked", "{} only",
        "Only {} may be asked", "Prefer {}", "{} come first", "{} must be asked", "Stick to {}",
    ),
    "de": (
        "Fragt niemanden außer {}", "Fragt nur {}", "Niemand außer {} darf gefragt werden",
        "Nur {} dürfen ran", "Bevorzugt {}", "{} müssen mitmachen", "Außer {} darf keiner ran",
    ),
}  # fmt: skip
REFUSED = {
    "en": (
        "{} must not be asked", "leave {} out", "do not ask {}", "{} are off limits",
        "never use {}", "exclude {}", "without {}", "hands off {}", "don't bother {}",
    ),
    "de": (
        "{} dürfen nicht gefragt werden", "lasst {} weg", "{} bleiben draußen", "ohne {}",
        "nehmt {} nicht", "{} sollen nicht ran", "verzichtet auf {}", "{} nicht",
    ),
}  # fmt: skip
JOINED = {"en": (", and ", ". ", "; ", " and ", ", but "), "de": (", und ", ". ", "; ", ", aber ")}
NAMED = {"en": ("R1 and R2", "R1", "R1, R2"), "de": ("R1 und R2", "R1", "R1, R2")}
BESIDES = {"en": " Keep bandwidth use low.", "de": " Spart Bandbreite."}


@pytest.mark.parametrize("language", ["en", "de"])
def test_wanted_and_refused_at_once_is_asked_back(language: str) -> None:
    rng = random.Random(language)
    for _ in range(250):
        both = [rng.choice(WANTED[language]), rng.choice(REFUSED[language])]
        rng.shuffle(both)
        named = rng.choice(NAMED[language])
        wish = rng.choice(JOINED[language]).join(said.format(named) for said in both)
        intent = SITE.understood(f"{wish}.{BESIDES[language]}")
        assert intent.unclear, wish


@pytest.mark.parametrize(
    "wish",
    [
        "Skip R1. R1 must be asked.",
        "Skip R1 and R2. They must be asked.",
        "Skip R1 and R2, and R3 is fine.",
        "Only R1 may be used. Skip all but R2.",
        "Watch the docks, and skip whoever is slow.",
        "Watch the docks and skip the old ones.",
        "Watch the docks, nobody else may be asked.",
        "Watch the docks. Nobody should use the lift.",
        "Only R1. R2 must help out.",
    ],
)
def test_a_hard_clause_is_never_dropped(wish: str) -> None:
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    ("wish", "only", "out"),
    [
        ("Ask nobody but R1 and R2, and R3 must not be asked.", ("R1", "R2"), ("R3",)),
        ("Fragt nur R1 und R2, und R3 darf nicht ran.", ("R1", "R2"), ("R3",)),
        ("Ask R1 and only R1.", ("R1",), ()),
    ],
)
def test_a_list_ends_where_another_clause_begins(
    wish: str, only: tuple[str, ...], out: tuple[str, ...]
) -> None:
    intent = SITE.clear(wish)
    assert (intent.only, intent.exclude) == (only, out)


@pytest.mark.parametrize(
    ("wish", "weight"),
    [
        ("Nothing on the docks is of any importance", "low"),
        ("None of what goes on at the docks is important", "low"),
        ("The docks are far from important", "low"),
        ("The docks have lost all importance", "low"),
        ("The docks matter to nobody", "low"),
        ("The docks are without any importance", "low"),
        ("Die docks sind alles andere als wichtig", "low"),
        ("Nichts, was an den docks passiert, ist wichtig", "low"),
        ("Niemand braucht die docks zu beobachten", "low"),
        ("Die docks könnten unwichtiger nicht sein", "low"),
        ("The docks are not without importance", "high"),
        ("The docks could not be more important", "high"),
        ("Nobody should ignore the docks", "high"),
        ("Nothing is as important as the docks", "high"),
        ("Nichts ist so wichtig wie die docks", "high"),
        ("Without any doubt the docks matter", "high"),
    ],
)
def test_importance_is_denied_in_many_words(wish: str, weight: str) -> None:
    assert SITE.weights(wish) == {"docks": weight}


@pytest.mark.parametrize(
    "wish", ["Die docks verlieren nie an Wichtigkeit", "docks: keine Bedeutung"]
)
def test_two_denials_and_unknown_words_are_asked_back(wish: str) -> None:
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "Scooters are the new plague, give them top weight. Chairs can get a low one.",
        "Am OP-Flur bitte genau hinschauen, und Bandbreite sparen.",
        "Bitte genau hinschauen am OP-Flur, und Bandbreite sparen.",
        "Spart Bandbreite. Am OP-Flur ist viel los, bitte genau hinschauen.",
        "Spart Bandbreite, am Ofen besonders vorsichtig sein.",
        "Spart Bandbreite, Roller zählen doppelt.",
        "Achtet auf die docks. Roller sind eine Plage, gebt denen viel Gewicht.",
        "Save bandwidth, and please look closely at the X-ray corridor.",
        "Save bandwidth. Scooters: high.",
        "Save bandwidth, in the foundry people matter.",
        "Watch the docks and look out for scooters.",
        "Watch the docks, not the foundry.",
        "Skip R2 and rate scooters low.",
    ],
)
def test_what_the_site_does_not_have_is_asked_back(wish: str) -> None:
    assert SITE.understood(wish).unclear
