"""Wishes that say as a whole who alone is asked, or who is not."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

HALL = WishSite("R1, R2, R3, R4", "docks, aisle 1", "person, pallet")


@pytest.mark.parametrize(
    ("wish", "names"),
    [
        ("leave everyone out except R2", "R2"),
        ("please skip everybody, except for R1 and R2", "R1 R2"),
        ("all but R1, R2 off", "R1 R2"),
        ("take all the robots out except the R3, thanks", "R3"),
        ("leave everyone out, just not R1.", "R1"),
        ("don't ask anyone except R4", "R4"),
        ("ask no one, only R1", "R1"),
        ("everyone but R1 may rest", "R1"),
        ("we need no more than R1 and R2", "R1 R2"),
        ("R1 is all we need", "R1"),
        ("we don't need more than R1 and R2", "R1 R2"),
        ("everybody out but R1", "R1"),
        ("all robots off, except R1", "R1"),
        ("alle außer R1 und R2 weglassen", "R1 R2"),
        ("alle weglassen außer R3", "R3"),
        ("nehmt alle raus, außer R1", "R1"),
        ("Bitte alle Roboter raus, bis auf den R3!", "R3"),
        ("lasst alle in Ruhe, außer R1", "R1"),
        ("alle raus, nur R1 nicht", "R1"),
        ("niemanden fragen, nur R1", "R1"),
        ("mehr als R1 und R2 brauchen wir nicht", "R1 R2"),
        ("kommt mit R2 aus", "R2"),
    ],
)
def test_all_others_are_out(wish: str, names: str) -> None:
    intent = HALL.clear(wish)
    assert (intent.only, intent.exclude) == (tuple(names.split()), ())
    until = HALL.clear(f"{wish.rstrip('.!')}, until six")
    assert (until.only, until.until) == (tuple(names.split()), "2026-11-23T18:00:00+01:00")


@pytest.mark.parametrize(
    ("wish", "names"),
    [
        ("let R1 charge", "R1"),
        ("please leave R1 and R2 to rest", "R1 R2"),
        ("don't rely on R3", "R3"),
        ("take R3 offline", "R3"),
        ("can we please skip R3?", "R3"),
        ("would you mind leaving R3 out?", "R3"),
        ("make sure nobody asks R3", "R3"),
        ("lasst R1 in Ruhe laden", "R1"),
        ("hört nicht auf R1", "R1"),
        ("schließt R2 und R4 aus", "R2 R4"),
        ("können wir R3 bitte weglassen?", "R3"),
        ("ich möchte, dass ihr R3 weglasst", "R3"),
        ("es wäre nett, wenn ihr den R3 weglasst", "R3"),
        ("bitte stellt sicher, dass R3 nicht gefragt wird", "R3"),
    ],
)
def test_these_are_out(wish: str, names: str) -> None:
    intent = HALL.clear(wish)
    assert (intent.exclude, intent.only) == (tuple(names.split()), None)
    timed = HALL.clear(f"until six, {wish}")
    assert (timed.exclude, timed.until) == (tuple(names.split()), "2026-11-23T18:00:00+01:00")


@pytest.mark.parametrize(
    ("wish", "exclude", "only"),
    [
        ("none of the robots except R1", "", "R1"),
        ("ask none of our robots except R1", "", "R1"),
        ("apart from R1, leave everyone out", "", "R1"),
        ("apart from R1 don't ask anyone", "", "R1"),
        ("bis auf R1 alle weglassen", "", "R1"),
        ("all of the robots except R1 are to be left out", "", "R1"),
        ("only R3 is to be left out", "R3", ""),
        ("leave out only R3", "R3", ""),
        ("nur R3 weglassen", "R3", ""),
        ("bis auf R3 alle fragen", "R3", ""),
        ("apart from R3 ask everyone", "R3", ""),
        ("keinen weglassen außer R3", "R3", ""),
    ],
)
def test_an_exception_may_come_first(wish: str, exclude: str, only: str) -> None:
    intent = HALL.clear(wish)
    assert (" ".join(intent.exclude), " ".join(intent.only or ())) == (exclude, only)


@pytest.mark.parametrize(
    "wish",
    [
        "R3 can stay in, leave R1 out",
        "leave R3 in and take R1 out",
        "R1 out, R3 stays in though",
        "R3 must stay in whatever happens, but take R1 out",
        "der R3 kann ruhig mitmachen, den R1 aber weglassen",
    ],
)
def test_who_stays_in_beside_who_is_out_needs_no_question(wish: str) -> None:
    intent = HALL.clear(wish)
    assert (intent.exclude, intent.only, intent.prefer) == (("R1",), None, ())


@pytest.mark.parametrize(
    "wish", ["R1 stays in", "R1 can stay in, R1 out", "can R3 stay in? R1 out"]
)
def test_who_stays_in_alone_or_is_out_as_well_is_asked_about(wish: str) -> None:
    assert HALL.understood(wish).unclear


def test_a_time_may_stand_within() -> None:
    intent = HALL.clear("lasst R1 bis vier laden")
    assert (intent.exclude, intent.until) == (("R1",), "2026-11-23T16:00:00+01:00")


@pytest.mark.parametrize(
    "wish",
    [
        "R1 is charging",
        "can we skip R3?  or is it needed",
        "should we skip R3?",
        "can we skip R3?",
        "können wir R3 weglassen?",
        "let R1 charge at the docks",
        "let R1 charge, if it is empty",
        "könnten wir R3 oder R4 weglassen?",
        "don't let R1 charge",
        "skip everyone except R1 until six, until seven",
    ],
)
def test_what_asks_reports_or_supposes_leaves_nobody_out(wish: str) -> None:
    intent = HALL.understood(wish)
    assert intent.exclude == () or intent.unclear


@pytest.mark.parametrize(
    "wish",
    [
        "everyone except R1 is charging",
        "everyone is out except R1",
        "alle außer R1 laden",
        "R1 is the only one",
        "leave everyone out except R2 at the docks",
        "leave everyone out except R2, if it rains",
        "leave everyone out except R2, and R3 first",
        "leave everyone out except R2 today",
        "leave everyone out except R9",
        "ask anyone except R2",
    ],
)
def test_what_reports_or_says_more_is_not_read_so(wish: str) -> None:
    intent = HALL.understood(wish)
    assert intent.only is None or intent.unclear
