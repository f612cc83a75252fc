"""What a trained model says of a wish counts by how sure it is, beside what words say."""

from __future__ import annotations

import json
from datetime import datetime

import pytest

from llm_gateway.model import Prompt, Reply
from llm_gateway.wishes import understand
from llm_gateway.wishes.weigh import SURE, SURE_OF_HARD
from swarm.messages.intent import Intent, Site

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")
SITE = Site(
    robots=("R1", "R2", "R3", "R4"),
    places=("docks", "aisle 1"),
    classes=("person", "pallet"),
)
UNSURE = SURE / 2


class Says:
    """A model that gives words, each with how likely it finds it."""

    model = "says"
    trained = True

    def __init__(self, *words: tuple[str, float]) -> None:
        pieces: list[tuple[str, float]] = []
        for word, chance in words:
            pieces += [("," if pieces else "[", 1.0), (json.dumps(word), chance)]
        self._reply = Reply("".join([*(p for p, _ in pieces), "]"]), likely=(*pieces, ("]", 1.0)))

    def read(self, prompt: Prompt) -> Reply:
        assert prompt.certainty
        return self._reply


def understood(wish: str, *words: tuple[str, float]) -> Intent:
    return understand(wish, SITE, NOW, Says(*words))


def test_what_no_cue_says_stands_where_the_model_is_sure() -> None:
    said = "leave R3 out. The docks give me the jitters"
    words = ("out", 1.0), ("high", 1.0), ("all", 1.0)
    assert understand(said, SITE, NOW, None).focus == ()
    intent = understood(said, *words)
    assert [(focus.place, focus.weight) for focus in intent.focus] == [("docks", "high")]
    assert (intent.exclude, intent.unclear) == (("R3",), ())


@pytest.mark.parametrize("whole", [1.0, UNSURE])
def test_it_is_asked_back_where_the_model_is_not(whole: float) -> None:
    said = "leave R3 out. The docks give me the jitters, we guess"
    assert understand(said, SITE, NOW, None).unclear, "words alone ask back"
    assert understood(said, ("out", 1.0), ("high", UNSURE), ("all", whole)).unclear


@pytest.mark.parametrize("role", ["out", "only", "first"])
def test_nothing_hard_counts_on_the_models_word_alone(role: str) -> None:
    intent = understood("R3 has had a gutsful, give it a spell", (role, 1.0), ("all", 1.0))
    assert (intent.exclude, intent.only, intent.prefer) == ((), None, ())
    assert "R3" in intent.unclear


def test_the_model_may_confirm_what_words_suggest() -> None:
    said = "leave R3 alone whilst flummoxed"
    assert understand(said, SITE, NOW, None).exclude == ()
    assert understood(said, ("out", 1.0), ("all", 1.0)).exclude == ("R3",)
    for chance in (UNSURE, (SURE + SURE_OF_HARD) / 2):
        assert understood(said, ("out", chance), ("all", 1.0)).unclear


def test_a_part_that_words_cannot_read_is_not_passed_over() -> None:
    said = "leave R3 out. Seventy percent, that is what the neighbours talk about"
    intent = understood(said, ("out", 1.0), ("none", 1.0), ("all", 1.0))
    assert (intent.exclude, intent.q_min, intent.link_share) == (("R3",), None, None)
    assert intent.unclear


def test_what_words_plainly_say_stands_beside_a_model_that_says_the_same_or_nothing() -> None:
    for word, chance in (("out", UNSURE), ("none", 1.0), ("none", UNSURE)):
        assert understood("leave R3 out", (word, chance), ("all", 1.0)).exclude == ("R3",)


@pytest.mark.parametrize("chance", [1.0, UNSURE])
def test_where_words_and_model_contradict_each_other_the_person_is_asked(chance: float) -> None:
    intent = understood("leave R3 out", ("first", chance), ("all", 1.0))
    assert (intent.exclude, intent.prefer) == ((), ())
    assert "R3" in intent.unclear


def test_what_is_read_as_a_whole_stands_whatever_the_model_says() -> None:
    for word in ("out", "first", "none"):
        intent = understood("all but R3 off", (word, 1.0), ("all", 1.0))
        assert (intent.only, intent.exclude, intent.unclear) == (("R3",), (), ())


def test_an_aside_is_none_where_the_model_is_sure_of_that_and_of_the_whole() -> None:
    said = "leave R3 out, the pallets were there at seven"
    assert understand(said, SITE, NOW, None).unclear
    sure = understood(said, ("out", 1.0), ("none", 1.0), ("none", 1.0), ("all", 1.0))
    assert (sure.exclude, sure.classes, sure.until, sure.unclear) == (("R3",), {}, None, ())
    part = understood(said, ("out", 1.0), ("none", 1.0), ("none", 1.0), ("part", 1.0))
    assert part.unclear


def test_a_model_that_is_sure_of_no_wish_makes_the_swarm_ask() -> None:
    intent = understood("leave R3 out", ("none", 1.0), ("nothing", 1.0))
    assert (intent.exclude, intent.unclear) == ((), ("leave R3 out",))
    assert understood("leave R3 out", ("none", 1.0), ("nothing", UNSURE)).exclude == ("R3",)


def test_nobody_may_be_said_by_the_model() -> None:
    said = "no pestering any of them until six, no exceptions whatsoever"
    intent = understood(said, ("when", 1.0), ("nobody", 1.0))
    assert intent.only == ()
    assert intent.until == "2026-11-23T18:00:00+01:00"
    assert understood(said, ("when", 1.0), ("nobody", UNSURE)).only is None


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ("leave R9 out", [("none", 1.0), ("all", 1.0)]),
        ("leave R3 out from 8 to 10 today", [("out", 1.0), ("none", 1.0), ("all", 1.0)]),
        ("leave R3 out from 8 to 10 today", [("out", 1.0), ("when", 1.0), ("all", 1.0)]),
        ("only R2, and leave R2 out", [("only", 1.0), ("out", 1.0), ("all", 1.0)]),
        ("skip R3 until last night", [("out", 1.0), ("none", 1.0), ("all", 1.0)]),
        ("skip R3 for a week", [("out", 1.0), ("all", 1.0)]),
        ("skip R3 after the break", [("out", 1.0), ("all", 1.0)]),
        ("skip R3, well, until five, I mean six", [("out", 1.0), ("when", 1.0), ("all", 1.0)]),
        ("skip R3 and whoever is slow", [("out", 1.0), ("all", 1.0)]),
        ("Ask nobody. R3 is out.", [("out", 1.0), ("all", 1.0)]),
        ("Ask nobody, R3 is the exception", [("only", 1.0), ("nobody", 1.0)]),
        ("R3 first, ask nobody today", [("first", 1.0), ("none", 1.0), ("nobody", 1.0)]),
    ],
)
def test_names_that_do_not_exist_times_that_are_over_and_contradictions_are_codes_to_tell(
    wish: str, words: list[tuple[str, float]]
) -> None:
    assert understood(wish, *words).unclear


def test_no_model_is_asked_about_what_words_read_as_a_whole() -> None:
    class Silent:
        model = "silent"
        trained = True

        def read(self, prompt: Prompt) -> Reply:
            raise AssertionError(prompt)

    assert understand("all but R1 off until six", SITE, NOW, Silent()).only == ("R1",)
    assert understand('the sign says "skip R1"', SITE, NOW, Silent()).unclear


def test_nobody_is_asked_on_the_models_word_only_where_words_say_no_or_all() -> None:
    said = Says(("save", 1.0), ("when", 1.0), ("nobody", 1.0))
    assert understand("save bandwidth until six", SITE, NOW, said).only is None
    said = Says(("when", 1.0), ("nobody", 1.0))
    assert understand("nae robots tae be asked till six", SITE, NOW, said).only == ()
