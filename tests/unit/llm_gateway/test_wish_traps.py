"""Words around cues by which a wish says something else than they do: it is asked back."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    "R1, R2, R3, R4, R5, R6", "aisle 1, aisle 2, docks, racks", "person, forklift, pallet"
)
understood, clear = SITE.understood, SITE.clear
DAY, OTHER_DAY = "2026-11-23", "2026-12-03"


@pytest.mark.parametrize(
    "wish",
    [
        "leave R1 in",
        "leave R1 on",
        "leave R1 running",
        "leave R1 switched on",
        "leave R1 in the pool",
        "leave R1 as is",
        "leave it to R1",
        "please leave it to R1 until six",
        "let R1 do it alone",
        "let R1 work alone",
        "take R1 off the bench",
        "R1 stays off the bench",
        "take R1 off the blacklist",
        "remove R1 from the blacklist",
        "R1 von der Sperrliste nehmen",
        "R1 is off the sick list",
        "R1 is out of maintenance",
        "R1 is out of danger",
        "R1 ist aus der Werkstatt",
        "holt R1 aus der Wartung",
        "R1 pause over",
        "without R1 nothing works",
        "nothing works without R1",
        "we are lost without R1",
        "niemand ohne R1",
        "R1 is hardly ever off",
        "skip R1 to R3, but keep R2",
        "skip R1 and R2. Keep R2.",
        "skip R1 and R2. R2 is fine though.",
        "skip R1 to R3, R2 stays",
        "R1 to R3 out, R2 in",
        "skip R1 to R3, R2 not",
        "lasst R1 bis R3 weg, aber R2 bleibt drin",
        "skip R3, keep R3",
    ],
)
def test_what_keeps_a_robot_in_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "raise the quality by 0.1",
        "increase quality by 10 percent",
        "10 Prozent mehr Qualität",
        "Qualität um 0,1 erhöhen",
        "improve precision by 5 percent",
        "quality may drop by 10 percent",
        "cut the bandwidth by 20 percent",
        "reduce link usage by 30%",
        "spart 30 Prozent Bandbreite",
        "senkt die Bandbreite um 30 Prozent",
        "use a third less bandwidth",
        "use 20 percent more bandwidth",
        "use all but a third of the link",
        "stay 20 percent below the maximum bandwidth",
        "we already use 80 percent of the bandwidth",
        "currently 80 percent of the bandwidth are used",
        "the link has lost a third",
        "a third of the link is broken",
        "a third of packets are lost on the link",
        "the link is 30 percent slower",
        "quality fell to 80 percent",
        "the detector has a precision of 80 percent",
        "half the link must not be used",
        "not even half of the link",
        "don't use half the link",
        "die Hälfte der Bandbreite darf nicht genutzt werden",
        "never use a third of the link",
        "80 percent quality is not enough",
        "80 percent precision is too low",
        "80 Prozent Qualität reichen nicht",
        "half the link is too much",
        "half the link is too little",
        "half the link, except for R3",
        "half the link, or better a third",
        "give us 80 percent of the link",
        "we need 80 percent of the link",
        "wir brauchen 80 Prozent der Bandbreite",
        "leave us a third of the bandwidth",
    ],
)
def test_what_is_no_bound_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "skip R3 until five, I mean six",
        "skip R3 until five, sorry, six",
        "skip R3 until five - no, six",
        "skip R3 until five, six at the latest",
        "skip R3 until five, or better six",
        "nur R3 bis fünf, nein sechs",
        "nur R3 bis fünf - nein, sechs",
        "skip R3 for two hours, make it three",
        "skip R3 for two hours, no three",
        "skip R3 for two hours or three",
        "skip R3 for an hour or two",
        "R3 eine Stunde oder zwei weglassen",
        "skip R3 for two hours and ten",
        "skip R3 for twenty",
        "skip R3, four and five",
        "skip R3 and four",
        "skip R3 and two others",
        "R3 und vier raus",
        "skip R3 -- sorry, R4",
        "skip R3 ... R4",
        "only R3 -- sorry, R4",
        "nur R3, doch R4",
        "leave R3 out, rather R4",
        "lasst R3 weg, lieber R4",
    ],
)
def test_what_corrects_itself_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "R3 and R4, nobody else, except R5",
        "only R3 and R4, except R5",
        "use R1 and R2 - R3 out",
        "skip R3 and the blue robot",
        "skip R3 and whoever is slow",
        "skip R3 and all slow robots",
        "skip R3 and both newcomers",
        "skip R3 and one more",
        "only R3 and the blue robot",
        "only R3 and one other",
        "nur R3 und noch einer",
        "only R3 and whoever is near",
        "R3 and one other out",
        "skip R3 and up",
        "skip everyone from R3 on",
        "R3 aufwärts raus",
        "ab R3 alle raus",
        "skip the robots below R3",
        "skip all robots up to R4",
        "skip one of R1 and R2",
        "one of R1 and R2 out",
        "skip either of R1 and R2",
        "einer von R1 und R2 raus",
        "lasst einen von R1 und R2 weg",
        "two of R1, R2 and R3 out",
        "only two of R1, R2, R3",
        "only one of R1 and R2",
        "nur R3 oder doch R4",
    ],
)
def test_what_tells_not_who_is_meant_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "skip R3 until Monday 10:00",
        "R3 bis Montag 10:00 weglassen",
        "skip R3 from Monday 8:00",
        "skip R3 two hours later",
        "skip R3 ten minutes after six",
        "skip R3 every night from 22 to 6",
        "skip R3 every day from 15:00 to 16:00",
        "skip R3 each day until 18:00",
        "R3 jede Nacht von 22 bis 6 Uhr weglassen",
        "skip R3 for the rest of the day",
        "skip R3 all day",
        "skip R3 the whole day",
        "R3 für den Rest der Schicht weglassen",
        "R1 nur bis sechs nehmen",
        "R1 nur eine Stunde lang",
        "use R1 only until six",
        "use R1 only for an hour",
    ],
)
def test_what_tells_not_when_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "Anzeige Qualität 0,82",
        "Durchschnitt 0,85 Qualität",
        "I have taken R3 out",
        "Qualität nur noch bei 82 Prozent",
        "R3 is off track",
        "R3 is out of the way",
        "R3 ist auf dem Weg",
        "R3 ist außer Sicht",
        "R3 kurz weglassen",
        "R3 mindestens eine Stunde weglassen",
        "R3 nachher weglassen",
        "R3 notfalls weglassen",
        "R3 out?",
        "R3 vielleicht weglassen",
        "R3 weglassen, aber nur wenn er lädt",
        "R3 weglassen, falls es regnet",
        "R3 weglassen, sobald es regnet",
        "R3 weglassen, sofern er lädt",
        "R3 weglassen, wenn nötig",
        "R4 only after asking me",
        "R5 nur fragen, wenn es sein muss",
        "accuracy is 90 percent",
        "ask nobody, if there is a fire",
        "ask only R4 while R3 charges",
        "bandwidth usage is at 40 percent",
        "bei Feueralarm keinen fragen",
        "bei Störung R3 weglassen",
        "die Hälfte vom Link ist frei",
        "die letzte Schicht lief mit 90 Prozent Qualität",
        "half the link, if the cameras are on",
        "höchstens die halbe Bandbreite, wenn es langsam ist",
        "ich habe R3 abgeschaltet",
        "im Brandfall niemanden fragen",
        "im Regen R3 weglassen",
        "in an emergency ask nobody",
        "just R3 here",
        "lasst 30 Prozent vom Link",
        "link usage is 40 percent",
        "niemanden fragen, falls der Alarm losgeht",
        "niemanden fragen, wenn es brennt",
        "nur R3 antwortet",
        "on alarm ask nobody",
        "only R1, if it is free",
        "quality is at 82 percent",
        "skip R3 later",
        "skip R3 most of the time",
        "skip R3, as soon as it rains",
        "skip R3, but only if it is charging",
        "someone set the policy to rules",
        "surrogate decides now",
        "the wifi runs at 50 percent",
        "they take half the link",
        "use 20 percent of the link less",
        "vielleicht R3 weglassen",
        "we get 90 percent quality",
        "we have 90 percent quality",
        "we might skip R3",
        "we run at 90 percent quality",
        "when asked, skip R3",
        "wir haben 90 Prozent Qualität",
        "wir könnten R3 weglassen",
        "wir nutzen 40 Prozent der Bandbreite",
        "wir schaffen 90 Prozent Qualität",
    ],
)
def test_conditions_reports_and_questions_are_asked_back(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    ("wish", "out", "first"),
    [
        ("ask R1 and R2, R3 out", ("R3",), ()),
        ("R1 zuerst, dann R2, R3 nie", ("R3",), ("R1", "R2")),
        ("R1 first, then R2, R3 out", ("R3",), ("R1", "R2")),
        ("lasst R1 und R2, R3 weg", ("R1", "R2", "R3"), ()),
        ("R1, R2 out", ("R1", "R2"), ()),
        ("robots 3 till 5 out", ("R3", "R4", "R5"), ()),
        ("leave R1 in peace", ("R1",), ()),
        ("leave R1 on the bench", ("R1",), ()),
        ("let R1 go first", (), ("R1",)),
        ("let R1 rest", ("R1",), ()),
        ("skip R1, R2 and R3. R3 is in the docks", ("R1", "R2", "R3"), ()),
        ("no R1, no R2", ("R1", "R2"), ()),
        ("R1 raus, R2 zuerst", ("R1",), ("R2",)),
    ],
)
def test_who_is_out_and_who_is_first(
    wish: str, out: tuple[str, ...], first: tuple[str, ...]
) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.prefer) == (out, first)


@pytest.mark.parametrize(
    ("wish", "share"),
    [
        ("save half the link", 0.5),
        ("we need half the link", 0.5),
        ("we need 60 percent of the link for the cameras", 0.4),
        ("reduce link usage to 30%", 0.3),
        ("a third of the link at most", 0.333),
    ],
)
def test_a_part_that_is_plain_bounds(wish: str, share: float) -> None:
    assert clear(wish).link_share == pytest.approx(share, abs=0.001)


@pytest.mark.parametrize(
    ("wish", "start", "until"),
    [
        ("two hours from now, skip R3", f"{DAY}T16:05:00+01:00", None),
        ("skip R3 until two hours from now", None, f"{DAY}T16:05:00+01:00"),
        ("R3 bis 3.12. um 18 Uhr weglassen", None, f"{OTHER_DAY}T18:00:00+01:00"),
        ("until lunch, say 3 pm, skip R3", None, f"{DAY}T15:00:00+01:00"),
        ("skip R3 for ten minutes after six", f"{DAY}T18:00:00+01:00", f"{DAY}T18:10:00+01:00"),
        ("skip R3 until Tuesday 10:00", None, "2026-11-24T10:00:00+01:00"),
        ("R3 bis 12:00 weglassen", None, "2026-11-24T12:00:00+01:00"),
        ("skip R3 until 1 December at three", None, "2026-12-01T15:00:00+01:00"),
        ("skip R3 until the day after tomorrow at 8", None, "2026-11-25T08:00:00+01:00"),
        (
            "nur R1 von heute Abend um acht bis morgen um sechs",
            f"{DAY}T20:00:00+01:00",
            "2026-11-24T06:00:00+01:00",
        ),
        ("half the link while we load, until five", None, f"{DAY}T17:00:00+01:00"),
        ("R3 weg bis 18.30.", None, f"{DAY}T18:30:00+01:00"),
    ],
)
def test_when_it_begins_and_ends(wish: str, start: str | None, until: str | None) -> None:
    intent = understood(wish)
    assert (intent.start, intent.until) == (start, until)


def test_a_bound_says_not_how_much_a_thing_counts() -> None:
    intent = clear("quality at least 0.9 for people, they matter")
    assert (intent.q_min, intent.classes) == (0.9, {"person": "high"})


@pytest.mark.parametrize("word", ["at ", "so ", "until five, ", "R1 and ", "at from then "])
def test_long_wishes_of_times_alone_are_read_at_once(word: str) -> None:
    assert understood((word * 2000)[:1990] + "R3").unclear


@pytest.mark.parametrize(
    "wish",
    [
        "no robot is out except R3",
        "hört auf, R3 zu ignorieren",
        "einen von beiden, R2 oder R3, weglassen",
        "R3 out? No.",
        "R3 out, no hang on, I mean R2 out",
        "R3 is out, right?",
        "nobody wants R3 out",
        "R3 weglassen ist verboten",
        "don't ask R1 so often",
        "R1 nicht für alles fragen",
        "leave R3 out every second time",
        "R3 is off maintenance",
        "R3 ist von der Ladestation weg",
        "only R1 complained",
        "no one but R3 saw it",
        "alle außer R3 sind wieder da",
        "can you do without R3?",
        "reicht die halbe Leitung?",
        "Wenn's brennt, lasst R3 weg",
    ],
)
def test_what_sounds_like_leaving_out_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear
