"""What operators leave unsaid, wrap in courtesy, pass on for others, or say by an idiom."""

from __future__ import annotations

import pytest

from tests.support.wish_site import WishSite

SITE = WishSite(
    robots="R1, R2, R3, R4, lark-a, lark-b",
    places="docks, ramp, paint hall, Orchestergraben",
    classes="person, box, forklift, calf",
)
understood, clear, weights = SITE.understood, SITE.clear, SITE.weights


@pytest.mark.parametrize(
    ("wish", "weighed"),
    [
        ("ramp is closed, unimportant. docks are", {"ramp": "low", "docks": "high"}),
        ("boxes are unimportant. forklifts too", {"box": "low", "forklift": "low"}),
        ("docks wichtig, ramp nich", {"docks": "high", "ramp": "low"}),
        ("the docks matter a lot, the ramp hardly", {"docks": "high", "ramp": "low"}),
        ("Kisten sind zweitrangig, die Kälber ebenso", {"box": "low", "calf": "low"}),
        ("docks: people there! top prio", {"docks": "high", "person": "high"}),
        ("people on the ramp = top prio", {"ramp": "high", "person": "high"}),
        ("Stapler auf der ramp: beides rauf", {"ramp": "high", "forklift": "high"}),
        ("please rate boxes and the docks up", {"box": "high", "docks": "high"}),
    ],
)
def test_a_clause_may_lean_on_the_one_before_it(wish: str, weighed: dict[str, str]) -> None:
    assert weights(wish) == weighed


def test_a_robot_shares_what_was_said_of_another_one() -> None:
    assert clear("R1 kaputt -> raus, R3 ebenfalls").exclude == ("R1", "R3")
    assert clear("everyone but R1, whose lens is cracked, and R3, who is late").exclude == (
        "R1",
        "R3",
    )
    assert clear("R2 1st choice, R4 2nd").prefer == ("R2", "R4")


@pytest.mark.parametrize(
    "wish", ["R1, R3: yes. Everybody else: no.", "R1 und R3 ja, alle anderen nein"]
)
def test_a_no_to_all_the_others_is_none_to_who_was_named(wish: str) -> None:
    assert clear(wish).only == ("R1", "R3")


def test_signs_stand_for_words() -> None:
    assert clear("q >= 0.8").q_min == 0.8
    assert understood("q <= 0.8").unclear
    assert clear("go w/o R2").exclude == ("R2",)
    assert clear("R1 u. R3 zuerst").prefer == ("R1", "R3")


@pytest.mark.parametrize(
    ("wish", "weight"),
    [
        ("pay little attention to boxes", "low"),
        ("care a little more about boxes", "high"),
        ("Kisten kaum beachten", "low"),
        ("Kisten stärker beachten", "high"),
        ("boxes can't be watched closely enough", "high"),
        ("turn a blind eye to boxes", "low"),
        ("boxes are what I lose sleep over", "high"),
    ],
)
def test_a_word_for_little_turns_a_cue_around(wish: str, weight: str) -> None:
    assert weights(wish) == {"box": weight}


@pytest.mark.parametrize(
    "wish",
    [
        "I'd be delighted if R2 were left out",
        "It would be kind if you kept R2 out",
        "Mir wär's lieb, wenn R2 nicht gefragt würde",
        "My boss wants R2 left out",
        "Die Schichtleitung sagt, R2 weglassen",
        "I was told that R2 is broken, so skip it",
    ],
)
def test_courtesy_and_who_asked_for_it_change_nothing(wish: str) -> None:
    assert clear(wish).exclude == ("R2",)


@pytest.mark.parametrize(
    "wish",
    [
        "what would happen if R2 were left out",
        "I wonder whether coverage or rules is better",
        "Mich würde interessieren, ob surrogate besser war",
        "R3 says leave R2 out",
        "the display says leave R2 out",
        "leave R2 out, no wait, leave it in",
        "lasst R2 weg, ach nein, lasst ihn drin",
    ],
)
def test_questions_quotations_and_corrections_are_no_wishes(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert (intent.exclude, intent.only, intent.prefer, intent.policy) == ((), None, (), None)


def test_all_of_a_family_are_named_by_their_number() -> None:
    assert clear("both larks stay out").exclude == ("lark-a", "lark-b")
    assert clear("nobody but the two larks").only == ("lark-a", "lark-b")
    assert understood("the three larks stay out").unclear


@pytest.mark.parametrize(
    "wish",
    [
        "prefer zeus and R2",
        "R2 und Zeus bitte zuerst fragen",
        "leave Zeus alone, and watch the docks",
        "Zeus bitte schonen, docks wichtig",
        "penguins on the ramp matter most",
        "people on the balcony matter most",
        "R2 rather than Zeus",
        "docks high, atrium low",
    ],
)
def test_what_the_site_does_not_have_is_never_lost(wish: str) -> None:
    assert understood(wish).unclear


@pytest.mark.parametrize(
    "wish",
    [
        "cap the wifi at 30%, don't cap the wifi",
        "save bandwidth, but don't save bandwidth",
        "decide by surrogate and not by surrogate",
        "only R2, and leave R2 out",
        "ramp high priority, ramp low priority",
    ],
)
def test_a_contradiction_leaves_nothing_of_what_it_contradicts(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert intent.is_empty()


@pytest.mark.parametrize(
    "wish",
    ["skip R2 or R3", "don't just ask R2", "leave nobody but R2 out", "R2 nur im Notfall"],
)
def test_what_may_mean_its_opposite_is_asked_back(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert (intent.exclude, intent.only) == ((), None)


@pytest.mark.parametrize(
    ("wish", "share"),
    [
        ("half the link for us at most, the other half is for the press", 0.5),
        ("the tills get two thirds of the wifi, stay within the remaining third", 0.333),
        ("40 Prozent der Funkbandbreite gehören der Technik", 0.6),
    ],
)
def test_what_others_get_of_the_link_is_kept_free(wish: str, share: float) -> None:
    assert clear(wish).link_share == share


def test_who_has_how_much_of_the_link_is_no_wish() -> None:
    assert understood("the cameras use 70 percent of the network").link_share is None


@pytest.mark.parametrize(
    "wish", ["no robots asked at all", "lasst alle Roboter in Ruhe", "don't use a single robot"]
)
def test_nobody_may_be_asked(wish: str) -> None:
    assert clear(wish).only == ()


def test_a_place_is_named_again_by_its_main_word() -> None:
    assert weights("the paint hall is crowded, mind people and the hall") == {
        "paint hall": "high",
        "person": "high",
    }
    assert weights("Im Orchestergraben wird gebaut, der Graben ist wichtig") == {
        "Orchestergraben": "high"
    }


@pytest.mark.parametrize(
    "wish",
    [
        "Bulletin 12: leave R2 out",
        "R2 out, folks",
        "Morning all, R2 out please",
        "Frau Meier: R2 raus",
    ],
)
def test_numbers_of_papers_and_who_is_spoken_to_are_no_part_of_a_wish(wish: str) -> None:
    assert clear(wish).exclude == ("R2",)


@pytest.mark.parametrize(
    ("wish", "policy"),
    [
        ("coverage please, at most 80 % of the link", "coverage"),
        ("Coverage und Güte mindestens 0,78", "coverage"),
        ("at most 30 % of the link, and coverage", "coverage"),
        ("back to coverage please", "coverage"),
        ("coverage for two hours", "coverage"),
        ("surrogate on, R2 out", "surrogate"),
        ("llm aus, random rein", "random"),
        ("statt llm wieder rules", "rules"),
        ("kein surrogate mehr, sondern rules", "rules"),
        ("Policy von coverage auf static-late umstellen", "static-late"),
        ("von rules zu coverage wechseln", "coverage"),
        ("rules instead of surrogate", "rules"),
        ("use the rules policy, surrogate gave us odd picks", "rules"),
        ("coverage entscheidet, mit surrogate hatten wir Aussetzer", "coverage"),
    ],
)
def test_one_policy_takes_over_from_another(wish: str, policy: str) -> None:
    assert clear(wish).policy == policy


@pytest.mark.parametrize(
    "wish",
    [
        "use anything but surrogate",
        "no more surrogate",
        "llm off",
        "rules or surrogate, R2 out",
        "only coverage, quality 0.8",
        "mit coverage bitte, Güte 0,8",
        "Random checks today, R2 out",
    ],
)
def test_which_policy_is_asked_where_words_do_not_say(wish: str) -> None:
    intent = understood(wish)
    assert intent.unclear
    assert intent.policy is None


def test_coverage_of_something_is_no_policy() -> None:
    assert clear("good coverage of the docks matters most").policy is None
    assert clear("Wi-Fi coverage is poor, save bandwidth").policy is None


def test_robots_are_named_by_what_their_names_begin_with() -> None:
    assert clear("no lark robots until 15:00").exclude == ("lark-a", "lark-b")
    assert clear("only the larks").only == ("lark-a", "lark-b")
    assert clear("only the Rs").only == ("R1", "R2", "R3", "R4")
    assert clear("R1-3 out").exclude == ("R1", "R2", "R3")
    assert clear("R1 und -3 zuerst").prefer == ("R1", "R3")
    assert understood("no blue robots, docks high").unclear
    assert understood("no scout robots, docks high").unclear
    assert understood("none of the llamas may be asked, docks high").unclear


def test_a_policy_stands_behind_a_dash_and_nobody_makes_no_preference() -> None:
    assert clear("skip R2 - coverage").policy == "coverage"
    assert clear("policy: rules; link: 40 %; q: 0.75").link_share == 0.4
    intent = understood("nobody should ask R2, R3 first")
    assert intent.unclear
    assert intent.prefer == ()
