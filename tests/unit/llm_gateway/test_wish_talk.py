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


@pytest.mark.parametrize(
    "wish",
    [
        "R2 is 300 ms late since the 0400 reboot, leave it out",
        "R2's lidar mount is loose (INC 20817), leave it out",
        "R2 hat 300 ms Versatz, bitte weglassen",
        "R2 out, ticket CHG-5512",
        "R2 out, its scanner shows a 4 deg tilt",
        "R2 at 11 % SOC -> take it out",
        "Everyone may be asked except R2 (at < 15 % SoC).",
        "R2 raus, Akkustand 12 %",
        "R2 out, the rest are busy with the A350 offload",
        "R2 out, it has 3 dead cameras",
        "R2 out, GPU node 2 is dead",
        "R2 out, it is charging at the docks",
        "R2 steht an der ramp und lädt, bitte weglassen",
        "R2 nicht anfragen, hängt an der ramp",
        "am ramp wird geschweißt, R2 bitte weglassen",
        "R2 out, we're moving people",
        "there are people at the docks, so skip R2",
        "R2 raus, die rutschen weg",
        "R2 out, please carry on without it",
        "R2 out, it's slippery out there",
        "R2 out, it fell over at 11",
        "fürs Erste ohne R2, nur zum Testen",
    ],
)
def test_what_tells_how_things_are_is_not_asked_back(wish: str) -> None:
    assert clear(wish).exclude == ("R2",)


@pytest.mark.parametrize(
    "wish",
    [
        "R2 out, max 300 ms latency",
        "R2 out, at most 5 Mbit/s",
        "R2 out, ask 3 others",
        "R2 out, use 2 scouts",
        "es sind 2 Roboter erlaubt, R2 raus",
        "skip A350, R2 out",
        "no GH-1002, R2 out",
        "if the link goes over 40 %, use rules. 40 % of the link, R2 out",
        "shelf 5 is falling over, watch it. R2 out",
        "robots under 20 % charge out, R2 out",
        "R2 out while people are at the docks",
        "as long as people are at the docks, leave R2 out",
        "as soon as the wifi is down, use only R2",
        "quality 0.8 C3 out, R2 out",
        "R2 out, CPU at most 50 %",
        "docks down while they are at the ramp, R2 out",
        "R2 out, die mule weg",
    ],
)
def test_what_may_be_a_wish_of_its_own_is_asked_back(wish: str) -> None:
    assert understood(wish).unclear, wish


def test_how_loaded_something_is_bounds_nothing() -> None:
    assert clear("the link is 85 % full, use at most 30 % of it").link_share == 0.3
    assert clear("CPU is at 96 %, go easy on it").save == "compute"
    assert (
        clear("over 40 % airtime is bad as soon as it rains, so 40 % of the link").link_share == 0.4
    )
    assert clear("at most a tenth of the link, die Kransteuerung geht vor").link_share == 0.1
    assert understood("the link is at 40 %, R2 out").link_share is None
    assert understood("R2 has 40 % of the link, leave it out").link_share is None
    assert understood("quality not above 0.9").q_min is None


def test_what_leans_on_only_says_no_more() -> None:
    assert clear("only R1, we don't need more then").only == ("R1",)
    assert clear("R2 is charging, ask only R1").only == ("R1",)
    assert clear("keep it to R1 and R2").only == ("R1", "R2")
    assert understood("only R1. R2 has to be asked too").only is None


def test_a_wish_may_be_told_as_what_one_would_rather_see() -> None:
    assert clear("I'd rather you took R1 before anyone else").prefer == ("R1",)
    assert clear("we'd rather you didn't ask R3").exclude == ("R3",)
    assert clear("nobody should ask R3").exclude == ("R3",)


def test_a_cue_for_robots_lowers_no_place() -> None:
    intent = understood("R1 waits at the docks with a flat tyre, leave out")
    assert (intent.exclude, intent.focus) == (("R1",), ())
