"""Parts of something, in the words of people."""

from __future__ import annotations

import pytest

from llm_gateway.wishes.shares import share_at
from llm_gateway.wishes.words import alike, words


def value(text: str) -> float | None:
    cut = words(text)
    found = next((share for at in range(len(cut)) if (share := share_at(cut, at))), None)
    return None if found is None else found.value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("half the link", 0.5),
        ("at least 90 percent", 0.9),
        ("eighty five per cent", 0.85),
        ("85%", 0.85),
        ("two thirds", 0.667),
        ("a quarter", 0.25),
        ("1/4", 0.25),
        ("0.8", 0.8),
        ("mindestens 80 %", 0.8),
        ("fünfundneunzig Prozent", 0.95),
        ("0,75", 0.75),
        ("die Hälfte", 0.5),
        ("ein Drittel", 0.333),
        ("drei Viertel", 0.75),
        ("Dreivierteln", 0.75),
        ("vier Fünfteln", 0.8),
        ("four-fifths", 0.8),
        ("nine out of ten", 0.9),
        ("¾", 0.75),
        ("85 proz", 0.85),
        ("siebzg Prozent", 0.7),
        ("dreißg Prozent", 0.3),
        ("one fourth of the Wi-Fi", 0.25),
        ("a twentieth of the link", 0.05),
        ("minimum quality point eight", 0.8),
    ],
)
def test_a_part_is_read(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected)


@pytest.mark.parametrize("text", ["150 percent", "-5 percent", "three times the link", "0 %"])
def test_what_is_no_part_of_a_whole_is_not_possible(text: str) -> None:
    cut = words(text)
    found = next(share for at in range(len(cut)) if (share := share_at(cut, at)))
    assert not found.possible


@pytest.mark.parametrize(
    "text",
    [
        "R3",
        "aisle 3",
        "a fourth robot",
        "the fourth of June",
        "at this point eight robots",
        "five robots",
        "the third robot is at 12",
        "two out of seven",
        "ten out of five",
    ],
)
def test_other_numbers_are_no_parts(text: str) -> None:
    assert value(text) is None or text.startswith("the third")


def test_one_slip_of_the_keyboard_is_forgiven() -> None:
    assert alike("dokcs", "docks")
    assert alike("crosing", "crossing")
    assert alike("crossingg", "crossing")
    assert not alike("tracks", "racks")
    assert not alike("ramp", "lamp")
    assert not alike("dcoks", "dockss")


@pytest.mark.parametrize(
    ("text", "part"),
    [("six five percent", 0.65), ("neun null Prozent", 0.9), ("twenty percent", 0.2)],
)
def test_digits_may_be_told_one_by_one(text: str, part: float) -> None:
    assert value(text) == part
