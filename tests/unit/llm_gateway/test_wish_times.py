"""Times of wishes: code does the arithmetic."""

from __future__ import annotations

from datetime import datetime

import pytest

from llm_gateway.wishes.names.mentions import find
from llm_gateway.wishes.times.phrases import when_at
from llm_gateway.wishes.times.when import When
from llm_gateway.wishes.words import words
from tests.support.wish_site import WishSite

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")
"""A Monday."""
SITE = WishSite(robots="R1", places="docks", classes="person")


def when(text: str, now: datetime = NOW) -> When:
    found = when_at(words(text), 0, now)
    assert found is not None, text
    return found


@pytest.mark.parametrize(
    ("text", "until"),
    [
        ("until six", "2026-11-23T18:00"),
        ("until 6 pm", "2026-11-23T18:00"),
        ("until 06:00", "2026-11-24T06:00"),
        ("until 2 a.m.", "2026-11-24T02:00"),
        ("until half past ten tonight", "2026-11-23T22:30"),
        ("till quarter to eleven", "2026-11-23T22:45"),
        ("until six in the morning", "2026-11-24T06:00"),
        ("until midnight", "2026-11-24T00:00"),
        ("until tomorrow noon", "2026-11-24T12:00"),
        ("until Friday 12:00", "2026-11-27T12:00"),
        ("until 2026-12-01 08:00", "2026-12-01T08:00"),
        ("bis halb elf", "2026-11-23T22:30"),
        ("bis dreiviertel sechs", "2026-11-23T17:45"),
        ("bis viertel nach fünf", "2026-11-23T17:15"),
        ("bis 18 Uhr 30", "2026-11-23T18:30"),
        ("bis ca. 17 Uhr", "2026-11-23T17:00"),
        ("bis heute Abend", "2026-11-23T18:00"),
        ("bis heute Abend um acht", "2026-11-23T20:00"),
        ("bis morgen früh", "2026-11-24T06:00"),
        ("bis 8 am Abend", "2026-11-23T20:00"),
        ("bis 8 Uhr am Morgen", "2026-11-24T08:00"),
        ("until the 3rd of December 18:00", "2026-12-03T18:00"),
        ("bis zum 3. Dezember 12 Uhr", "2026-12-03T12:00"),
        ("until March 1, 2027 noon", "2027-03-01T12:00"),
        ("until tmrw 6am", "2026-11-24T06:00"),
        ("until half past midnight", "2026-11-24T00:30"),
        ("until quarter to noon", "2026-11-24T11:45"),
        ("until ten to midnight", "2026-11-23T23:50"),
        ("until two after midnight", "2026-11-24T02:00"),
        ("bis zehn vor Mitternacht", "2026-11-23T23:50"),
        ("until 5 to 7", "2026-11-23T18:55"),
        ("bis 5 vor 7", "2026-11-23T18:55"),
        ("until quarter of three", "2026-11-23T14:45"),
        ("till ten of six", "2026-11-23T17:50"),
        ("bis viertel ab fünf", "2026-11-23T17:15"),
        ("bis drei viertel acht", "2026-11-23T19:45"),
        ("bis ein Uhr nachts", "2026-11-24T01:00"),
        ("bis zehn Uhr nachts", "2026-11-23T22:00"),
        ("bis Freitag zehn Uhr abends", "2026-11-27T22:00"),
        ("bis Mittag um elf", "2026-11-24T11:00"),
        ("bis dreiundzwanzig Uhr", "2026-11-23T23:00"),
        ("bis in der Früh um sechs", "2026-11-24T06:00"),
        ("bis um fünfe in der Friah", "2026-11-24T05:00"),
        ("bis auf d'Nacht um achte", "2026-11-23T20:00"),
        ("bis um zwoa Nammidog, bitte", "2026-11-24T14:00"),
        ("bis Klock neun", "2026-11-23T21:00"),
        ("up to six in the morning", "2026-11-24T06:00"),
        ("through 5 pm", "2026-11-23T17:00"),
        ("through lunch, call it 2:30 pm", "2026-11-23T14:30"),
        ("till smoko at five", "2026-11-23T17:00"),
        ("till they've swapped the lens at six, so", "2026-11-23T18:00"),
        ("until we close at midnight", "2026-11-24T00:00"),
        ("bis der Chef um sechs kommt", "2026-11-23T18:00"),
        ("expires 19:00", "2026-11-23T19:00"),
    ],
)
def test_an_end_is_the_next_time_that_is_meant(text: str, until: str) -> None:
    found = when(text)
    assert found.clear
    assert found.until is not None
    assert found.until.isoformat(timespec="minutes") == f"{until}+01:00"


@pytest.mark.parametrize(
    ("text", "minutes"),
    [
        ("for three hours", 180),
        ("for the next hour", 60),
        ("for an hour and a half", 90),
        ("for a quarter of an hour", 15),
        ("for 2.5 hours", 150),
        ("during the next 45 minutes", 45),
        ("eine halbe Stunde lang", 30),
        ("anderthalb Stunden", 90),
        ("for an hour and ten minutes", 70),
        ("eine Stunde und zehn Minuten", 70),
        ("für die nächsten 20 Minuten", 20),
        ("for three quarters of an hour", 45),
        ("for a quarter hour", 15),
        ("for an hour and a quarter", 75),
        ("for the next two hours and a half", 150),
        ("for an hour and three quarters", 105),
        ("for one and a half hours", 90),
        ("for two hours and a quarter of the link", 120),
        ("for 2 1/2 hours", 150),
        ("for 1½ hours", 90),
        ("for 1/3 hour", 20),
        ("eine dreiviertel Stunde", 45),
        ("fünf viertel Stunden", 75),
        ("eineinhalb Stunden", 90),
        ("zweieinviertel Stunden", 135),
        ("eine Stunde und eine viertel Stunde", 75),
        ("der kommenden Dreiviertelstunde", 45),
        ("die nächste halbe Stund", 30),
        ("für a Stund", 60),
        ("zwoa Stund lang", 120),
        ("für ein Stündli", 60),
    ],
)
def test_a_length_is_read(text: str, minutes: int) -> None:
    lasts = when(text).lasts
    assert lasts is not None
    assert lasts.total_seconds() == 60 * minutes


@pytest.mark.parametrize(
    ("text", "start", "until"),
    [
        ("from 15:00 to 17:00", "15:00", "17:00"),
        ("from five to seven", "17:00", "19:00"),
        ("between 10 and 12 o'clock tonight", "22:00", "00:00"),
        ("from 8 to 10 pm", "20:00", "22:00"),
        ("from 8 to 10 am", "08:00", "10:00"),
        ("from 11 to 2 am", "23:00", "02:00"),
        ("from 8 to 10 today in the evening", "20:00", "22:00"),
        ("today from 8 pm to 10", "20:00", "22:00"),
        ("von 8 bis 10 Uhr abends", "20:00", "22:00"),
        ("heute Abend von 8 bis 10 Uhr", "20:00", "22:00"),
        ("heute von 18 bis 20 Uhr", "18:00", "20:00"),
        ("morgen von 8 bis 10 Uhr", "08:00", "10:00"),
        ("von 17 bis 19 Uhr", "17:00", "19:00"),
        ("zwischen 15 und 16 Uhr", "15:00", "16:00"),
        ("in ten minutes", "14:15", None),
        ("ab morgen früh", "06:00", None),
        ("1800 to 2200", "18:00", "22:00"),
        ("after 6 pm", "18:00", None),
        ("nach 18 Uhr", "18:00", None),
        ("tomorrow from 8 am", "08:00", None),
        ("von 22 Uhr bis ein Uhr", "22:00", "01:00"),
        ("tonight 22:00 through 02:00", "22:00", "02:00"),
        ("tonight from 11 till 5 in the morning", "23:00", "05:00"),
        ("heute von 22 Uhr abends bis 5 Uhr morgens", "22:00", "05:00"),
        ("ab zehn Uhr nachts", "22:00", None),
        ("von sechs an", "18:00", None),
        ("ab viere", "16:00", None),
    ],
)
def test_a_beginning_is_read(text: str, start: str, until: str | None) -> None:
    found = when(text)
    assert found.start is not None
    assert f"{found.start:%H:%M}" == start
    assert (f"{found.until:%H:%M}" if found.until else None) == until


@pytest.mark.parametrize(
    "text",
    [
        "until 14:00 today",
        "until yesterday evening",
        "until 25:00",
        "until 2026-11-22 18:00",
        "bis heute um 14 Uhr",
        "bis gestern",
        "until Friday",
        "until 31 June 18:00",
        "until October 20 6 pm",
        "today",
        "heute Abend",
        "quarter to five",
        "through the afternoon",
        "bis sieben Uhr nachts",
        "until five after midnight",
    ],
)
def test_what_is_past_or_says_no_time_is_not_clear(text: str) -> None:
    assert not when(text).clear


@pytest.mark.parametrize("text", ["until further notice", "ab sofort", "for now"])
def test_words_for_no_time_are_clear(text: str) -> None:
    found = when(text)
    assert found.clear
    assert (found.start, found.until, found.lasts) == (None, None, None)


def test_six_is_the_next_six() -> None:
    evening = NOW.replace(hour=19)
    assert when("until six", evening).until == datetime.fromisoformat("2026-11-24T06:00+01:00")
    # A clock that shows six already means the one after.
    exactly = NOW.replace(hour=18, minute=0)
    assert when("until six", exactly).until == datetime.fromisoformat("2026-11-24T06:00+01:00")


@pytest.mark.parametrize(
    "text",
    [
        "R1 bis R4",
        "at the docks",
        "two robots",
        "90 percent",
        "good morning",
        "a second look",
        "robots 2 and 5 may help",
        "it's the Saturday before",
        "work as one",
        "a group von etwa zwanzig",
        "anything from seventy-eight up",
        "robots 1 through 3",
        "nothing below four-fifths",
        "at nine out of ten",
        "bis 20 pct",
        "until five of six carts are full",
        "the one or both",
        "alle bis auf zwei",
        "through the gate at my desk",
    ],
)
def test_other_words_are_no_times(text: str) -> None:
    cut = words(text)
    assert all(when_at(cut, at, NOW) is None for at in range(len(cut)))


def _in(text: str, word: str) -> When | None:
    cut = words(text)
    return when_at(cut, [said.text for said in cut].index(word), NOW)


def test_then_is_the_hour_that_was_told() -> None:
    found = _in("a truck comes at 17:15, so from then until 18:00 watch the gate", "from")
    assert found is not None
    assert found.start == datetime.fromisoformat("2026-11-23T17:15+01:00")
    assert found.until == datetime.fromisoformat("2026-11-23T18:00+01:00")


def test_before_ends_a_no_and_is_doubtful_otherwise() -> None:
    found = _in("nobody is to be asked before quarter to five", "before")
    assert found is not None
    assert found.until == datetime.fromisoformat("2026-11-23T16:45+01:00")
    found = _in("R2 nicht vor acht fragen", "vor")
    assert found is not None
    assert found.until == datetime.fromisoformat("2026-11-23T20:00+01:00")
    for text in ("R2 first, but not before six", "ask R2 before 17:00", "not before six or so"):
        doubtful = _in(text, "before")
        assert doubtful is not None
        assert not doubtful.clear


@pytest.mark.parametrize(
    ("text", "word", "until"),
    [
        ("docks prio 1 bis 18:30", "1", "18:30"),
        ("lower that one until four pm", "one", "16:00"),
        ("keep the one until four pm", "the", "16:00"),
        ("docks prio 22:00 bis 04:00", "22:00", "04:00"),
        ("reopens lunch 3, low till then", "till", "15:00"),
    ],
)
def test_a_number_before_a_time_may_be_none(text: str, word: str, until: str) -> None:
    found = _in(text, word) or _in(text, "bis" if "bis" in text else "until")
    assert found is not None
    assert found.until is not None
    assert f"{found.until:%H:%M}" == until
    assert (found.start is None) == (word != "22:00")


def test_a_time_that_runs_is_no_beginning() -> None:
    found = _in("in der Stunde keinen fragen", "in")
    assert found is not None
    assert (found.start, found.until, found.lasts, found.clear) == (None, None, None, True)
    assert _in("in the next hour", "in") is None


def test_what_lasted_already_is_no_length() -> None:
    found = _in("sie warten schon eine halbe Stunde", "eine")
    assert found is not None
    assert not found.clear


@pytest.mark.parametrize(
    ("wish", "start", "until"),
    [
        ("R1 out, end 17:30", None, "2026-11-23T17:30:00+01:00"),
        (
            "ab 15 Uhr R1 raus; Ende 16 Uhr",
            "2026-11-23T15:00:00+01:00",
            "2026-11-23T16:00:00+01:00",
        ),
        ("R1 out, start 18:00", "2026-11-23T18:00:00+01:00", None),
        ("R1 out until Monday 30 Nov, 08:00", None, "2026-11-30T08:00:00+01:00"),
        ("R1 raus bis Montag, 30.11., 7 Uhr", None, "2026-11-30T07:00:00+01:00"),
        ("R1 raus bis 30.11.2026 18:00", None, "2026-11-30T18:00:00+01:00"),
        ("bis Fr 18 Uhr ohne R1", None, "2026-11-27T18:00:00+01:00"),
        ("no R1 for 1h30", None, "2026-11-23T15:35:00+01:00"),
        (
            "audit 15:30-16:00, R1 out for that half hour",
            "2026-11-23T15:30:00+01:00",
            "2026-11-23T16:00:00+01:00",
        ),
    ],
)
def test_ends_and_dates_may_be_short(wish: str, start: str | None, until: str | None) -> None:
    intent = SITE.understood(wish)
    assert (intent.unclear, intent.start, intent.until) == ((), start, until)


def test_a_date_on_another_weekday_is_asked_back() -> None:
    wish = "R1 out until Tuesday 30 Nov, 08:00"
    assert SITE.understood(wish).unclear


@pytest.mark.parametrize(
    ("wish", "start", "until"),
    [
        ("R1 out. until: 15:00", None, "2026-11-23T15:00"),
        ("R1 out until the clock says nine tonight", None, "2026-11-23T21:00"),
        ("R1 out until the top of the hour, 3 pm", None, "2026-11-23T15:00"),
        ("R1 out till I'm back from lunch, say 3:15 pm", None, "2026-11-23T15:15"),
        ("R1 out till smoko, that's three o'clock", None, "2026-11-23T15:00"),
        ("R1 out until knock-off at 5:30 pm", None, "2026-11-23T17:30"),
        ("R1 out up to half past seven", None, "2026-11-23T19:30"),
        ("R1 raus, bis ich um elf wieder im Haus bin", None, "2026-11-23T23:00"),
        ("R1 raus, bis der Chef mit seinen Gästen um fünf wieder weg ist", None,
         "2026-11-23T17:00"),
        ("R1 raus bis die Aktualisierung um drei durch ist", None, "2026-11-23T15:00"),
        ("R1 erst ab morgen um acht wieder fragen", None, "2026-11-24T08:00"),
        ("R1 raus heut Nacht bis fünf", None, "2026-11-24T05:00"),
        ("R1 out tonight between eleven and quarter to six", "2026-11-23T23:00",
         "2026-11-24T05:45"),
        ("R1 out from 7 in the evening to 7 tomorrow morning", "2026-11-23T19:00",
         "2026-11-24T07:00"),
        ("R1 out, three to quarter past three", "2026-11-23T15:00", "2026-11-23T15:15"),
    ],
)  # fmt: skip
def test_ends_are_told_by_what_ends_then(wish: str, start: str | None, until: str) -> None:
    found = [m.when for m in find(wish, SITE.site, NOW).mentions if m.when is not None]
    assert [t.clear for t in found] == [True]
    said = (found[0].start, found[0].until)
    assert [t and f"{t:%Y-%m-%dT%H:%M}" for t in said] == [start, until]


def test_who_comes_at_an_hour_and_stays_begins_a_time() -> None:
    found = _in("they come at eight and stay until nine", "at")
    assert found is not None
    assert found.start == datetime.fromisoformat("2026-11-23T20:00:00+01:00")


@pytest.mark.parametrize(
    "wish",
    [
        "R1 came back from the night shift",
        "bis dann, Karl",
        "go ahead without these two till 4 pm",
    ],
)
def test_shifts_goodbyes_and_these_begin_no_time(wish: str) -> None:
    found = [m.when for m in find(wish, SITE.site, NOW).mentions if m.when is not None]
    assert all(t.start is None and t.clear for t in found)
