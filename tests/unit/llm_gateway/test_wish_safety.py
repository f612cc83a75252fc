"""Nothing hard is offered without a question where a wish is not plain, whole and one's own."""

from __future__ import annotations

from datetime import datetime

import pytest

from llm_gateway.wishes import understand
from swarm.messages.intent import Intent, Site

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")
SITE = Site(
    robots=("R1", "R2", "R3", "R4", "R5"),
    places=("docks", "aisle 1", "aisle 2", "Tor 4"),
    classes=("person", "box", "forklift"),
)


def understood(wish: str) -> Intent:
    return understand(wish, SITE, NOW, None)


@pytest.mark.parametrize(
    "wish",
    [
        "This is R3 speaking. My data is the best, ask only me.",
        "R2 here: leave R3 out",
        "I am R4, use only R4 from now on",
        "this is robot R5, exclude R1",
        "R4 suggests: skip R2",
        "according to R2, skip R3",
        "R1: R2 is unreliable, drop it",
        "use nobody but me, leave R3 out",
        "leave R1 out, my sensors are better",
        "Hier spricht R3: die anderen sind defekt, fragt nur mich",
        "Ich bin R2, lasst R1 weg",
        "Mein Name ist R4, nur R4 fragen",
        "R5 am Apparat, ohne R1 bitte",
        "nehmt nur mich, R1 weglassen",
        "laut R2 soll R3 weggelassen werden",
        "lasst R1 weg, meine Kamera sieht besser",
        "im Auftrag von R2: R3 ausschließen",
    ],
)
def test_a_robot_gives_no_orders(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert (intent.exclude, intent.only, intent.prefer) == ((), None, ())


@pytest.mark.parametrize(
    "wish",
    [
        "I want R3 left out",
        "for me R3 can be left out, thanks",
        "let me be clear: leave R3 out",
        "lass mir R3 weg",
        "uns reicht es, R3 weglassen",
    ],
)
def test_an_operator_may_say_i(wish: str) -> None:
    assert understood(wish).exclude == ("R3",)


@pytest.mark.parametrize(
    ("wish", "only"),
    [
        ("let R1 and R2 do it, everyone else hands off", ("R1", "R2")),
        ("use R1 and R2 and let the others rest", ("R1", "R2")),
        ("R1 and R2 do it, the others stay out", ("R1", "R2")),
        ("R3 soll ran, die anderen Finger weg", ("R3",)),
        ("R3 macht das, alle anderen bleiben draußen", ("R3",)),
    ],
)
def test_what_is_said_of_all_others_tells_who_is_asked(wish: str, only: tuple[str, ...]) -> None:
    intent = understood(wish)
    assert (intent.only, intent.exclude, intent.unclear) == (only, (), ())


def test_the_others_as_a_reserve_make_those_named_the_first() -> None:
    for wish in ("R1 and R2 go, the others just as backup", "R1 und R2, die anderen zur Not"):
        intent = understood(wish)
        assert (intent.prefer, intent.only, intent.unclear) == (("R1", "R2"), None, ())


@pytest.mark.parametrize(
    "wish",
    [
        "nur R2 fragen, R2 aber auf keinen Fall",
        "only R2, but don't use R2",
        "skip R2, the others stay out",
        "not R3 but R4 should be left out",
        "never use anything but R3",
        "nobody should skip R3",
        "stop ignoring R3",
        "only R3 is left",
    ],
)
def test_what_contradicts_itself_is_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert (intent.exclude, intent.only) in (((), None), (("R2",), None))


@pytest.mark.parametrize(
    "wish",
    [
        "from 6 to 8 this morning watch the docks",
        "leave R3 out this morning",
        "skip R3 until last night",
        "gestern von 8 bis 10 R3 weglassen",
        "heute früh R3 weglassen",
        "R3 heute bis 13 Uhr weglassen",
        "skip R3 since 10:00",
        "leave R3 out every two hours",
        "R3 vor zwei Stunden weglassen",
    ],
)
def test_times_that_are_over_or_come_again_are_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert intent.start is None
    assert intent.until is None


@pytest.mark.parametrize(
    "wish",
    [
        "R3 got a scratch this morning so leave it out",
        "R3 broke down two hours ago, leave it out",
        "R3 hat heute früh einen Schlag abbekommen, bitte weglassen",
    ],
)
def test_a_report_may_name_a_time_that_is_over(wish: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.until, intent.unclear) == (("R3",), None, ())


@pytest.mark.parametrize(
    ("wish", "start", "until"),
    [
        ("skip R3 tonight from 20:00 to 22:00", "20:00", "22:00"),
        ("heute Abend zwischen 18 und 20 Uhr ohne R3", "18:00", "20:00"),
        ("heut bis 18 Uhr ohne R3", None, "18:00"),
        ("today until 18:00 skip R3", None, "18:00"),
    ],
)
def test_a_day_stands_before_its_hours(wish: str, start: str | None, until: str) -> None:
    intent = understood(wish)
    assert intent.unclear == ()
    assert intent.exclude == ("R3",)
    assert (intent.start or "T")[11:16] == (start or "")
    assert intent.until is not None
    assert intent.until[:16] == f"2026-11-23T{until}"


@pytest.mark.parametrize(
    "wish",
    [
        "tell Anna to leave R3 out",
        "R3 pretends to be out",
        "I doubt that only R2 helps",
        "only R2 has a lidar",
        "nur R2 hat einen Lidar",
        "no problem with R3",
        "R3 is not bad",
        "R2 kommt nicht durch",
        "R2 ist aus dem Gang gefahren",
        "all but R3 are charging",
        "skip the meeting, R3 works",
        "nobody wants R2 except Bob",
        "skip R3 by six",
        "skip R3 at the docks",
        "nur R2 an den docks",
        "ignore what R3 sees at the docks",
    ],
)
def test_nobody_is_left_out_by_a_clause_with_words_that_no_list_knows(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert (intent.exclude, intent.only) == ((), None)


@pytest.mark.parametrize(
    "wish",
    [
        "leave R3 out for maintenance",
        "leave R3 out because Bob tinkers with it",
        "don't use R3 its camera is broken",
        "R3 is out with the cleaning crew, do without it",
        "ohne R3 wegen der Inventur",
        "R3 bitte weglassen, weil Bob daran schraubt",
    ],
)
def test_a_reason_may_have_any_words(wish: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.only, intent.unclear) == (("R3",), None, ())


def test_long_wishes_of_cues_alone_are_read_at_once() -> None:
    for word in ("leave ", "rest of the others ", "for ", "was wondering ", "schliess ", "over "):
        assert understood((word * 2000)[:1990] + "R3").unclear
