"""Comparisons, superlatives and small words that decide what an operator's wish weighs."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    robots="R1, R2, R3, R4, lark-a, lark-b",
    places="docks, Gang 1, Gang 2",
    classes="person, forklift, ball, cow",
)
understood, clear, weights = SITE.understood, SITE.clear, SITE.weights


@pytest.mark.parametrize(
    ("wish", "until"),
    [
        ("Gang 2 ist bis sechs am wichtigsten", "2026-11-23T18:00"),
        ("docks bis 6 am wichtigsten", "2026-11-23T18:00"),
        ("bis 8 am Gang 2 aufpassen", "2026-11-23T20:00"),
        ("bis sechs am wenigsten auf docks achten", "2026-11-23T18:00"),
        ("bis 6am docks wichtig", "2026-11-24T06:00"),
        ("docks wichtig bis 6 am", "2026-11-24T06:00"),
        ("until six am docks matter", "2026-11-24T06:00"),
        ("until 6 am the docks matter", "2026-11-24T06:00"),
        ("watch the docks until six am, people too", "2026-11-24T06:00"),
    ],
)
def test_german_am_makes_no_morning(wish: str, until: str) -> None:
    assert clear(wish).until == f"{until}:00+01:00"


def test_german_am_leaves_a_number_to_its_list() -> None:
    assert weights("Gang 1 und 2 am wichtigsten") == {"Gang 1": "high", "Gang 2": "high"}


@pytest.mark.parametrize(
    "wish", ["people down here matter most", "people down there: watch them closely"]
)
def test_down_here_lowers_no_weight(wish: str) -> None:
    assert weights(wish) == {"person": "high"}


@pytest.mark.parametrize(
    "wish",
    [
        "Link is weak down here, use 25% of it at most",
        "the link is tight, use a quarter of it at most",
        "Das Netz ist schwach hier unten, höchstens ein Viertel davon",
        "Die Leitung ist knapp, höchstens 25 Prozent davon nutzen",
    ],
)
def test_a_part_of_a_weak_link_says_all_that_is_wished_of_it(wish: str) -> None:
    intent = clear(wish)
    assert (intent.link_share, intent.save) == (0.25, None)


def test_saving_that_is_wished_stands_beside_a_part() -> None:
    intent = clear("save bandwidth, and use at most half the link")
    assert (intent.link_share, intent.save) == (0.5, "bandwidth")


@pytest.mark.parametrize(
    "wish",
    [
        "R2 before R3",
        "docks high, and R2 before R3",
        "R2 ahead of R3, please",
        "R2 vor R3, und die docks sind nicht so wichtig",
        "R2 rather than R3 if you have the choice, R3 is so slow",
        "R2 lieber als R3, wenn ihr die Wahl habt",
        "R2 zuerst fragen, falls die Wahl besteht",
        "Bitte immer zuerst R2 fragen, erst danach die anderen",
        "always ask R2 first, only then the others",
    ],
)
def test_who_comes_before_another_one_is_preferred(wish: str) -> None:
    intent = clear(wish)
    assert (intent.prefer, intent.exclude, intent.only) == (("R2",), (), None)


@pytest.mark.parametrize(
    "wish", ["R2 before R3 goes offline", "R2 first. Keep the ground before R3 clear"]
)
def test_before_a_robot_that_does_something_compares_nothing(wish: str) -> None:
    assert "R3" in " ".join(understood(wish).unclear)


@pytest.mark.parametrize(
    "wish",
    [
        "R2 is always asked first",
        "they always ask R2 first",
        "R2 wird immer zuerst gefragt",
        "R2 is slow, give it low priority",
        "R2 mit geringer Priorität",
    ],
)
def test_reports_and_low_priorities_prefer_nobody(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert intent.is_empty()


@pytest.mark.parametrize(
    "wish",
    [
        "could we please have R2 left out?",
        "could I ask you to leave R2 out?",
        "Können wir bitte R2 auslassen?",
        "R2 überhaupt nicht",
        "R2 igonrieren",
    ],
)
def test_a_polite_or_hasty_wish_is_one(wish: str) -> None:
    assert clear(wish).exclude == ("R2",)


@pytest.mark.parametrize("wish", ["could we skip R2?", "Können wir R2 auslassen?"])
def test_a_question_is_none(wish: str) -> None:
    assert understood(wish).exclude == ()


@pytest.mark.parametrize(
    ("wish", "weighed"),
    [
        ("nothing matters more than Gang 1", {"Gang 1": "high"}),
        ("nothing matters less than Gang 1", {"Gang 1": "low"}),
        ("nichts ist wichtiger als die docks", {"docks": "high"}),
        ("nichts geht über Personen", {"person": "high"}),
        ("Gang 1 is shut, so give it low priority. R2 out", {"Gang 1": "low"}),
        ("we mend Gang 1, so it gets high priority. Use only R2", {"Gang 1": "high"}),
        ("Gang 1 ist voll, gebt ihr hohe Priorität. R2 raus", {"Gang 1": "high"}),
        ("R2: out. Forklifts: high priority", {"forklift": "high"}),
        (
            "The docks need little attention. The people in Gang 1 need a lot",
            {"docks": "low", "Gang 1": "high", "person": "high"},
        ),
        (
            "Gang 1 braucht viel Aufmerksamkeit, Gang 2 braucht wenig",
            {"Gang 1": "high", "Gang 2": "low"},
        ),
        ("patients and staff matter more than anything", {"person": "high"}),
        ("Patienten und Personal am wichtigsten", {"person": "high"}),
    ],
)
def test_what_counts_most_or_little_is_weighed(wish: str, weighed: dict[str, str]) -> None:
    assert weights(wish) == weighed


def test_personal_is_staff_in_german_only() -> None:
    assert clear("R2 is my personal favourite, so ask R2 first").classes == {}


def test_what_is_compared_at_a_place_is_asked_back() -> None:
    assert understood("nothing at the docks matters more than people").classes == {}


def test_people_of_a_reason_are_not_asked_back() -> None:
    assert clear("R2 auslassen, weil dann kaum Personal da ist").exclude == ("R2",)
    assert weights("people are asleep in Gang 1, so Gang 1 is not important") == {"Gang 1": "low"}


def test_sowie_begins_another_wish_or_goes_on_with_a_list() -> None:
    intent = clear("Bitte den Prozessor schonen sowie R1 und R2 vorziehen")
    assert (intent.save, intent.prefer) == ("compute", ("R1", "R2"))
    assert clear("R1 sowie R2 auslassen").exclude == ("R1", "R2")
    assert understood("Sowie R3 da ist, R2 raus").is_empty()


def test_an_unknown_robot_takes_no_known_one_with_it() -> None:
    intent = understood("Leave R9 and R1 alone please")
    assert intent.exclude == ("R1",)
    assert intent.unclear == ("R9",)
    assert understood("skip R9 and R1 is fine").exclude == ()


def test_a_family_may_be_named_one_by_one() -> None:
    assert clear("Only the two larks should share, so lark-a and lark-b").only == (
        "lark-a",
        "lark-b",
    )


def test_a_language_model_may_choose() -> None:
    intent = clear("Das LLM soll auswählen, aber ohne R2")
    assert (intent.policy, intent.exclude) == ("llm", ("R2",))


@pytest.mark.parametrize(
    ("wish", "weight"),
    [
        ("balls are nothing you need to look at", "low"),
        ("Bälle sind nichts, was wir sehen müssen", "low"),
        ("Bälle sind nix, worauf man achten muss", "low"),
        ("nothing to watch of the balls", "low"),
        ("balls are nothing to ignore", "high"),
        ("there is nothing as important as the balls", "high"),
        ("watch the balls like nothing else", "high"),
        ("Bälle sind nicht der Rede wert", "low"),
        ("Bälle dürfen hintanstehen", "low"),
        ("Bälle jucken uns ned", "low"),
        ("balls beat everything", "high"),
        ("balls are the main risk", "high"),
        ("balls are what scares me", "high"),
        ("rank balls low. people are not, rank those right up", "low"),
    ],
)
def test_nothing_and_idioms_weigh(wish: str, weight: str) -> None:
    assert weights(wish)["ball"] == weight


def test_a_dialect_article_hides_no_name() -> None:
    assert weights("schaugts auf d'Leut an den docks") == {"person": "high", "docks": "high"}
    assert weights("passt auf d’Küh auf") == {"cow": "high"}


@pytest.mark.parametrize(
    "wish",
    [
        "In der Lackiererei ist viel los, da besonders aufpassen. R2 raus",
        "Beim Hochregal wird gebaut, dort bitte genau hinschauen. R2 raus",
        "The foundry is packed, keep an eye out there. R2 out",
        "docks low. In the foundry it's hectic, be careful there",
        "R2 out. Something's up in the smelter, watch it",
        "R2 out. In the smelter, be careful",
        "R2 raus, s'Gießereitor im Blick behalten",
        "R2 raus, d'Lehrbuam san wichtig",
    ],
)
def test_there_may_be_where_nobody_knows(wish: str) -> None:
    assert understood(wish).unclear


def test_there_may_point_to_what_a_report_names() -> None:
    wish = "forklifts have been racing around the docks all week, so put forklifts there first"
    assert weights(wish) == {"forklift": "high", "docks": "high"}


def test_a_measure_may_go_down() -> None:
    assert weights("docks -> Gewicht runter; Gang 2 -> Gewicht rauf") == {
        "docks": "low",
        "Gang 2": "high",
    }
    assert understood("docks weighted up, docks weighted down").unclear


def test_an_unknown_class_that_is_weighed_is_asked_back() -> None:
    assert understood("class seal high, class person high").unclear
    assert understood("Schneepflüge ganz oben, docks hoch").unclear
