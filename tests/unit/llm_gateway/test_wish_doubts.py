"""Times that are over, or twice a day: what is asked back, and what the words leave no doubt of."""

from __future__ import annotations

from datetime import datetime

import pytest

from llm_gateway.wishes import understand
from swarm.messages.intent import Intent, Site

SITE = Site(robots=("R1", "R2"), places=("docks",), classes=("person",))


def understood(wish: str, at: str) -> Intent:
    """On a Monday."""
    return understand(wish, SITE, datetime.fromisoformat(f"2026-11-23T{at}:00+01:00"), None)


@pytest.mark.parametrize(
    ("at", "wish", "asked"),
    [
        (
            "14:05",
            "leave R1 out from 2 to 4",
            "from 2 to 4 has begun at 14:05: until 16:00, or tomorrow 02:00 to 04:00?",
        ),
        (
            "14:05",
            "ab 14 Uhr ohne R1",
            "ab 14 Uhr is over at 14:05: from now on, or tomorrow from 14:00 on?",
        ),
        (
            "13:10",
            "leave R1 out from 8 to 10 today",
            "from 8 to 10 today is over at 13:10: this evening 20:00 to 22:00, or tomorrow 08:00 "
            "to 10:00?",
        ),
        (
            "13:10",
            "R1 heute von 8 bis 10 Uhr nicht benutzen",
            "heute von 8 bis 10 Uhr is over at 13:10: this evening 20:00 to 22:00, or tomorrow "
            "08:00 to 10:00?",
        ),
        (
            "13:10",
            "ohne R1 von 8 bis 10 Uhr",
            "von 8 bis 10 Uhr is over at 13:10: this evening 20:00 to 22:00, or tomorrow 08:00 to "
            "10:00?",
        ),
        (
            "14:05",
            "between 10 and 12 o'clock leave R1 out",
            "between 10 and 12 o'clock is over at 14:05: this evening 22:00 to 00:00, or tomorrow "
            "10:00 to 12:00?",
        ),
        (
            "22:30",
            "leave R1 out from 8 to 10 today",
            "from 8 to 10 today is over at 22:30: tomorrow 08:00 to 10:00?",
        ),
        (
            "09:15",
            "skip R1 from 8 to 11",
            "from 8 to 11 has begun at 09:15: until 11:00, or this evening 20:00 to 23:00, or "
            "tomorrow 08:00 to 11:00?",
        ),
        (
            "13:10",
            "ohne R1 von 13 bis 15 Uhr",
            "von 13 bis 15 Uhr has begun at 13:10: until 15:00, or tomorrow 13:00 to 15:00?",
        ),
        (
            "15:10",
            "ohne R1 von 8 bis 17 Uhr",
            "von 8 bis 17 Uhr has begun at 15:10: until 17:00, or tomorrow 08:00 to 17:00?",
        ),
        (
            "13:10",
            "watch the docks from 12 to 2",
            "from 12 to 2 has begun at 13:10: until 14:00, or tonight 00:00 to 02:00, or tomorrow "
            "12:00 to 14:00?",
        ),
        (
            "13:10",
            "heute ab 8 Uhr ohne R1",
            "heute ab 8 Uhr is over at 13:10: from now on, or this evening from 20:00 on, or "
            "tomorrow from 08:00 on?",
        ),
        (
            "13:10",
            "ohne R1 bis heute 10 Uhr",
            "bis heute 10 Uhr is over at 13:10: until 22:00, or until tomorrow 10:00?",
        ),
        (
            "13:10",
            "leave R1 alone until 10 today",
            "until 10 today is over at 13:10: until 22:00, or until tomorrow 10:00?",
        ),
    ],
)
def test_a_time_that_is_over_is_asked_back(at: str, wish: str, asked: str) -> None:
    intent = understood(wish, at)
    assert intent.unclear == (asked,)
    assert (intent.start, intent.until) == (None, None)


@pytest.mark.parametrize(
    ("at", "wish", "start", "until"),
    [
        ("13:10", "leave R1 out from 8 to 10 tonight", "23T20:00", "23T22:00"),
        ("13:10", "leave R1 out from 8 to 10 pm", "23T20:00", "23T22:00"),
        ("13:10", "leave R1 out from 8 to 10 am", "24T08:00", "24T10:00"),
        ("13:10", "leave R1 out from 20:00 to 22:00 today", "23T20:00", "23T22:00"),
        ("13:10", "leave R1 out from 8 to 10 tomorrow", "24T08:00", "24T10:00"),
        ("13:10", "leave R1 out today from 2 to 4 pm", "23T14:00", "23T16:00"),
        ("13:10", "ohne R1 von 8 bis 10 Uhr morgens", "24T08:00", "24T10:00"),
        ("13:10", "ohne R1 heute Abend von 8 bis 10 Uhr", "23T20:00", "23T22:00"),
        ("13:10", "ohne R1 von 08:00 bis 10:00", "24T08:00", "24T10:00"),
        ("18:10", "ohne R1 von 8 bis 17 Uhr", "24T08:00", "24T17:00"),
        ("07:10", "heute von 8 bis 10 Uhr ohne R1", "23T08:00", "23T10:00"),
        ("07:10", "leave R1 out from 8 to 10 today", "23T08:00", "23T10:00"),
        # The next one is nearer than the one that is over.
        ("14:05", "leave R1 out from five to seven", "23T17:00", "23T19:00"),
        ("21:15", "leave R1 out from ten to eleven", "23T22:00", "23T23:00"),
    ],
)
def test_words_that_say_which_one_are_obeyed(at: str, wish: str, start: str, until: str) -> None:
    intent = understood(wish, at)
    assert intent.unclear == ()
    assert intent.start == f"2026-11-{start}:00+01:00"
    assert intent.until == f"2026-11-{until}:00+01:00"


def test_an_end_without_a_day_is_the_next_one() -> None:
    assert understood("leave R1 alone until six", "14:05").until == "2026-11-23T18:00:00+01:00"
    assert understood("leave R1 alone until six", "19:17").until == "2026-11-24T06:00:00+01:00"
