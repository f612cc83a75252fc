"""Talk beside a wish: stories, reasons, who is at work; and wishes that verbs and ifs say."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    robots="R1, R2, R3, R4, lark-a, lark-b",
    places="docks, ramp",
    classes="person, box, forklift",
)
understood, clear, weights = SITE.understood, SITE.clear, SITE.weights


@pytest.mark.parametrize(
    "wish",
    [
        "R2 out, always",
        "everyone except R2. That one's got dust all over its eyes",
        "R2 raus, der Prüfer schaut zu",
        "R2 out, the fire inspectors want it",
        "R2 raus, die Kollegen vom Service machen ein Update",
        "R2 raus. Keine Angst, das ist nur die Feuerwehr",
        "a forklift nearly hit R2, leave R2 out",
        "R2 is the worst one, don't ask it",
        "den R2 lasst lieber weg",
        "R2 möge außen vor bleiben",
        "as quiet as a church on a Monday, R2 out",
        "alle bis auf R2, der muss dann beim Abbau helfen",
    ],
)
def test_talk_beside_a_wish_is_not_asked_back(wish: str) -> None:
    assert clear(wish).exclude == ("R2",)


@pytest.mark.parametrize(
    "wish",
    [
        "ask R2 before the larks",
        "ask R2 ahead of R3",
        "I'd sooner you asked R2 than anyone",
        "ask R2 before the rest as he's just had his lens cleaned",
        "ich hätt gern, dass erst R2 gefragt wird und dann der Rest",
    ],
)
def test_who_is_asked_sooner_is_preferred(wish: str) -> None:
    intent = clear(wish)
    assert (intent.prefer, intent.exclude, intent.only) == (("R2",), (), None)


@pytest.mark.parametrize(
    "wish",
    [
        "Mir genügt's, wenn R1 und R3 gefragt werden",
        "it's enough if you ask R1 and R3",
        "Mir reicht's, wenn ihr R1 und R3 fragt, sonst bitte keinen",
    ],
)
def test_who_is_enough_is_asked_alone(wish: str) -> None:
    assert clear(wish).only == ("R1", "R3")


@pytest.mark.parametrize("wish", ["skip R2 if there's enough light", "lieber R2 weglassen als R3"])
def test_what_is_supposed_or_compared_leaves_nobody_out(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert intent.is_empty()


def test_a_verb_orders_when_a_wish_begins_and_ends() -> None:
    intent = clear("Start at 15:15 with the rules policy and stop at 16:45")
    assert (intent.policy, intent.start, intent.until) == (
        "rules",
        "2026-11-23T15:15:00+01:00",
        "2026-11-23T16:45:00+01:00",
    )
    assert understood("we start at six so watch the docks until nine").start is None


def test_a_policy_may_be_all_that_is_said() -> None:
    assert clear("Coverage ab halb vier.").policy == "coverage"
    assert understood("Coverage from the docks matters").policy is None


def test_what_an_idle_condition_names_is_not_asked_back() -> None:
    assert weights("a box won't cry if you bump it, so boxes: low") == {"box": "low"}
    assert understood("if boxes block the ramp watch the ramp").unclear


def test_forgetting_one_place_takes_no_wish_back() -> None:
    assert weights("docks are priority, ramp is down so forget that one") == {
        "docks": "high",
        "ramp": "low",
    }


def test_aber_sehr_turns_around_what_was_said() -> None:
    assert weights("Die docks sind nicht so wichtig; die ramp aber sehr") == {
        "docks": "low",
        "ramp": "high",
    }


def test_who_is_at_work_may_be_looked_out_for() -> None:
    wish = "folks install the rack at the docks, watch out for them"
    assert weights(wish) == {"docks": "high", "person": "high"}
