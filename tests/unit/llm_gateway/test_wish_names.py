"""What operators call the robots and the places of the project's own factory."""

from __future__ import annotations

from datetime import datetime

import pytest

from llm_gateway.wishes.names.mentions import find
from swarm.messages.intent import Site

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")
SITE = Site(
    robots=tuple(f"R{number}" for number in range(1, 13)),
    places=("aisle 1", "aisle 2", "aisle 3", "cross aisle 1", "crossing", "docks", "racks",
            "machines", "conveyors"),
    classes=("person", "forklift", "pallet", "cart"),
)  # fmt: skip


def named(wish: str, site: Site = SITE) -> list[tuple[str, tuple[str, ...]]]:
    kinds = ("robot", "place", "unknown")
    return [(m.kind, m.names) for m in find(wish, site, NOW).mentions if m.kind in kinds]


def robots(*numbers: int) -> list[tuple[str, tuple[str, ...]]]:
    return [("robot", tuple(f"R{number}" for number in numbers))]


@pytest.mark.parametrize(
    ("said", "place"),
    [
        ("die Maschinen", "machines"),
        ("Maschinenbereich", "machines"),
        ("machine area", "machines"),
        ("Förderbänder", "conveyors"),
        ("an den Förderbändern", "conveyors"),
        ("conveyor belts", "conveyors"),
        ("the belts", "conveyors"),
        ("Quergang 1", "cross aisle 1"),
        ("im Quergang", "cross aisle 1"),
        ("the cross aisle until six", "cross aisle 1"),
        ("Quergang zwei Stunden lang", "cross aisle 1"),
        ("Laderampe", "docks"),
        ("loading docks", "docks"),
        ("Kreuzung", "crossing"),
        ("junction", "crossing"),
        ("Regale", "racks"),
        ("racking", "racks"),
    ],
)
def test_the_factory_s_places_have_words_of_both_languages(said: str, place: str) -> None:
    assert named(said) == [("place", (place,))]


@pytest.mark.parametrize(
    ("wish", "aisles"),
    [
        ("Gänge 2 und 3", (2, 3)),
        ("aisles one and two", (1, 2)),
        ("aisle two & three are loose", (2, 3)),
        ("aisles one through three", (1, 2, 3)),
        ("Gänge 1 bis 3 hoch", (1, 2, 3)),
        ("aisles 1, 2, and 3", (1, 2, 3)),
        ("Gang 1 bis 3", (1,)),
        ("aisle two and three people", (2,)),
        ("Gänge 1 bis 3 Uhr", (1,)),
    ],
)
def test_numbers_of_places_go_on_as_lists_and_ranges(wish: str, aisles: tuple[int, ...]) -> None:
    assert named(wish) == [("place", tuple(f"aisle {number}" for number in aisles))]


@pytest.mark.parametrize("wish", ["cross aisle 2", "Rampe 3", "aisles one through seven"])
def test_a_place_is_never_taken_for_another(wish: str) -> None:
    assert named(wish) == [("unknown", ())]


def test_a_word_for_a_place_is_that_of_the_place_that_is_called_so() -> None:
    site = Site(robots=(), places=("docks", "ramp"), classes=())
    assert named("Rampe", site) == [("place", ("ramp",))]
    assert named("Laderampe", site) == []
    assert named("the ramp in hall B") == []


@pytest.mark.parametrize(
    ("wish", "numbers"),
    [
        ("robots 5 to 8 out", (5, 6, 7, 8)),
        ("Robots three to six are loading", (3, 4, 5, 6)),
        ("robots 2 and 5 to 7", (2, 5, 6, 7)),
        ("Die Roboter vier bis acht", (4, 5, 6, 7, 8)),
        ("skip number five", (5,)),
        ("number four's broken", (4,)),
        ("den mit der Nummer 3", (3,)),
        ("numbers 2, 5 and 7 out", (2, 5, 7)),
        ("Die Drei hat kaum noch Saft", (3,)),
        ("nur die Sechs nicht", (6,)),
        ("Ohne Eins bitte", (1,)),
        ("Zwölf raus, danke", (12,)),
        ("7 and 8 out", (7, 8)),
        ("Sieben, acht, neun raus", (7, 8, 9)),
        ("skip four and five until 9 tonight", (4, 5)),
        ("keine anfrage an 7 und 8", (7, 8)),
        ("Two, four and six. Just those.", (2, 4, 6)),
        ("Drei Roboter genügen: eins, sechs, elf.", (1, 6, 11)),
        ("the odd-numbered robots", (1, 3, 5, 7, 9, 11)),
        ("die geraden Nummern", (2, 4, 6, 8, 10, 12)),
        ("Die Nummern, also 2, 4, 6, 8, 10 und 12.", (2, 4, 6, 8, 10, 12)),
    ],
)
def test_robots_are_told_by_number(wish: str, numbers: tuple[int, ...]) -> None:
    assert named(wish) == robots(*numbers)


def test_robots_that_are_compared_by_number_are_two() -> None:
    assert named("Prefer four over five.") == robots(4) + robots(5)
    assert named("Lieber die Eins als die Vier") == robots(1) + robots(4)


@pytest.mark.parametrize(
    "wish",
    [
        "R1, R2, R3 sind müde, die Drei bitte raus",
        "Die Drei sollen raus",
        "Gang 2 hoch, die Drei runter",
        "skip 4",
        "Drei raus",
        "only 2 and 3",
        "Roboter 4 bis 8 weglassen",
        "Die Roboter 3 und 5 bis 8 weg",
        "robots 5 to 80 out",
        "number 40 out",
    ],
)
def test_a_number_that_may_be_something_else_is_asked_back(wish: str) -> None:
    found = named(wish)
    assert [names for kind, names in found if kind == "unknown"] == [()]
    assert all(names[0] in {"R1", "aisle 2"} for kind, names in found if kind != "unknown")


@pytest.mark.parametrize(
    "wish",
    [
        "Die Drei Stapler",
        "in der Drei liegt was",
        "skip two or three",
        "only two and three forklifts",
        "use 3",
        "docks are the number one priority",
        "that's priority number one",
        "the odd ones out",
        "aisle number three",
        "part number 5",
        "nur 7 bis 8 Uhr",
        "keep 80, bis um die Drei",
        "between 7 and 8",
        "eins, zwei, drei, los",
        "we lost two and three of them",
    ],
)
def test_counts_hours_and_other_numbers_are_no_robots(wish: str) -> None:
    assert "robot" not in {kind for kind, _ in named(wish)}


def test_bare_numbers_are_no_robots_among_those_with_names() -> None:
    site = Site(robots=("scout-1", "heron", "tern-7"), places=(), classes=())
    assert named("skip 1 and 7", site) == []
    assert named("skip number 7", site) == [("robot", ("tern-7",))]


def test_a_digit_that_stands_for_no_decimal_is_no_number() -> None:
    assert named("skip ፩ until ፩") == []


@pytest.mark.parametrize("wish", ["R1 to R999999999", "robots 1 to 999999999", "R1-999999999"])
def test_nobody_counts_through_a_range_with_more_numbers_than_robots(wish: str) -> None:
    site = Site(robots=("R1", "R2", "R999999999"), places=(), classes=())
    assert named(wish, site) == [("unknown", ())]
