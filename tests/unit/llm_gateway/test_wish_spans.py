"""A time that is not the time of what is wished is asked about."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    "R1, R2, R3, R4, R5, R6", "aisle 1, aisle 2, docks, racks", "person, forklift, pallet"
)


@pytest.mark.parametrize(
    "wish",
    [
        "leave R3 out; from six it may be asked again",
        "R3 out, but from six it can be used again",
        "only R1; from six the others are back",
        "R3 weglassen, ab sechs ist er wieder da",
        "jetzt ohne R3, ab sechs mit ihm",
        "at most half the link now, from six no limit",
        "R3 out, it's back in two hours",
        "R3 raus, in zwei Stunden ist er wieder da",
        "the lorry comes in ten minutes, leave R3 out",
        "we open in ten minutes, so people matter most until six",
        "R3 raus, ab sechs auch R2",
        "leave R3 out until six, after that skip R2",
        "watch the docks until the lunch rush dies down",
        "leave R3 out from three; at four you can have it again",
        "from three to five without R3, then without R2",
        "R3 only from six on",
    ],
)
def test_what_begins_later_is_something_else(wish: str) -> None:
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "R3 is 20 minutes late, skip it",
        "R3's map is two days old, leave it out",
        "die Karte von R3 ist zwei Tage alt, weglassen",
        "R3 ist zehn Minuten zu spät, weglassen",
        "R3's clock is two hours off, leave it out",
        "the lorry has waited for ten minutes, leave R3 out",
        "I'll be ten minutes late, leave R3 out",
        "R3 can only be asked until six",
        "R3 ist nur bis sechs da",
    ],
)
def test_a_length_that_is_told_ends_nothing(wish: str) -> None:
    intent = SITE.understood(wish)
    assert intent.unclear or intent.until is None


@pytest.mark.parametrize(
    ("wish", "start", "until"),
    [
        ("R3 out in ten minutes", "14:15", ""),
        ("from six on, leave R3 out", "18:00", ""),
        ("R3 leaves at four, so skip it from then", "16:00", ""),
        ("from three on, ask only R1, and that for two hours", "15:00", "17:00"),
        ("use static-late until six, then do as you like", "", "18:00"),
        ("R3 needs a break from three to five", "15:00", "17:00"),
    ],
)
def test_a_time_of_the_wish_stands(wish: str, start: str, until: str) -> None:
    intent = SITE.clear(wish)
    assert [(time or "")[11:16] for time in (intent.start, intent.until)] == [start, until]
