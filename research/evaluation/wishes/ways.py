"""Ways to understand a wish: the product's, and controls of which each leaves something out."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime

from llm_gateway.model import Prompt, Reply
from llm_gateway.wishes import Reader, account, form, understand
from llm_gateway.wishes.compose import compose
from llm_gateway.wishes.names.mentions import find
from llm_gateway.wishes.understand import prompt
from research.training.wishes.cases import Case
from swarm.errors import GatewayError
from swarm.messages.intent import Intent, Site

Way = Callable[[Case], Intent]


class RandomReader:
    """Draws any answer that the form allows, and how sure it is of each word."""

    model = "random"
    trained = True

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)

    def read(self, prompt: Prompt) -> Reply:
        """One word of each list."""
        items = json.loads(prompt.schema)["prefixItems"]
        words = [self._chance.choice(item["enum"]) for item in items]
        likely: list[tuple[str, float]] = []
        for at, word in enumerate(words):
            likely += [(",", 1.0)] if at else [("[", 1.0)]
            likely.append((json.dumps(word), self._chance.random()))
        likely.append(("]", 1.0))
        return Reply("".join(piece for piece, _ in likely), likely=tuple(likely))


class Remembering:
    """Asks a reader once for each prompt, so that two ways compare the same answers."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._answers: dict[Prompt, Reply] = {}
        self.model = reader.model
        self.trained = reader.trained

    def read(self, prompt: Prompt) -> Reply:
        """The answer, or the one before. Raises GatewayError."""
        if prompt not in self._answers:
            self._answers[prompt] = self._reader.read(prompt)
        return self._answers[prompt]


def checked(reader: Reader | None) -> Way:
    """As the product does it; None: by rules only."""

    def way(case: Case) -> Intent:
        try:
            return understand(case.wish, case.site, case.time, reader)
        except GatewayError as error:
            return Intent(unclear=(str(error)[:200],))

    return way


def unchecked(reader: Reader) -> Way:
    """On the model's word alone: names, times and numbers are found by code all the same. What it
    takes is not told."""

    return lambda case: _on_its_word(case.wish, case.site, case.time, reader)


def _on_its_word(wish: str, site: Site, now: datetime, reader: Reader) -> Intent:
    text = find(wish, site, now)
    try:
        said = form.parse(text, reader.read(prompt(text, trained=reader.trained)))
    except (GatewayError, ValueError) as error:
        return Intent(unclear=(str(error)[:200],))
    if said.verdict == "nothing":
        return Intent(unclear=(wish,))
    settled = account.settle(text, said)
    if said.verdict == "part" and not settled.unclear:
        settled = replace(settled, unclear=(wish,))
    return compose(text, settled, now)
