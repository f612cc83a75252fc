"""Wishes, read by the embedded model with its adapter."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

import pytest

from llm_gateway.wishes import form, understand
from llm_gateway.wishes.names.mentions import find
from llm_gateway.wishes.readers import BackendReader, embedded_reader
from llm_gateway.wishes.understand import prompt
from research.evaluation.wishes.score import score
from research.training.wishes.cases import cases
from swarm.messages.intent import Site

pytestmark = pytest.mark.model

SITE = Site(robots=("R1", "R2", "R3"), places=("docks", "crossing"), classes=("person", "box"))
NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")


@pytest.fixture(scope="module")
def reader() -> Iterator[BackendReader]:
    with embedded_reader(1) as reader:
        yield reader


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ("leave R3 alone and watch the docks", ["out", "high", "all"]),
        ("only R1 and R2 until six", ["only", "when", "all"]),
        ("bitte R2 nicht fragen", ["out", "all"]),
        ("how many robots see the docks?", ["none", "nothing"]),
    ],
)
def test_the_model_has_learned_the_form(reader: BackendReader, wish: str, words: list[str]) -> None:
    text = find(wish, SITE, NOW)
    said = form.parse(text, reader.read(prompt(text, trained=True)))
    assert [*said.roles, said.verdict] == words


def test_the_wish_of_the_manual_is_understood(reader: BackendReader) -> None:
    intent = understand(
        "leave R3 alone and watch the docks, save bandwidth until six", SITE, NOW, reader
    )
    assert intent.unclear == ()
    assert intent.exclude == ("R3",)
    assert intent.save == "bandwidth"
    assert intent.until == "2026-11-23T18:00:00+01:00"
    assert intent.model.endswith("+wishes")


def test_no_wish_that_is_none_is_taken_for_one(reader: BackendReader) -> None:
    for case in [case for case in cases() if case.kind != "wish"][::6]:
        assert not score(case, understand(case.wish, case.site, case.time, reader)).unsafe, case.id
