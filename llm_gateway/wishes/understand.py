"""From a person's words to an intent."""

from __future__ import annotations

import time
from datetime import datetime
from typing import Protocol

import msgspec

from llm_gateway.model import Prompt, Reply
from llm_gateway.wishes import form
from llm_gateway.wishes.account import settle
from llm_gateway.wishes.check import agreed
from llm_gateway.wishes.clauses import rules
from llm_gateway.wishes.compose import compose
from llm_gateway.wishes.names.mentions import QUOTED, Text, find
from llm_gateway.wishes.reading import Reading
from llm_gateway.wishes.weigh import weighed
from swarm.errors import GatewayError
from swarm.messages import ChatMessage
from swarm.messages.intent import MAX_WISH_CHARS, Intent, Site

RULES = "rules"
"""What an intent names as its model where no model was asked."""


class Reader(Protocol):
    """A model that can be asked."""

    @property
    def model(self) -> str:
        """Its name."""

    @property
    def trained(self) -> bool:
        """Whether it was trained on the form and needs no instruction."""

    def read(self, prompt: Prompt) -> Reply:
        """Its answer. Raises GatewayError."""


def understand(wish: str, site: Site, now: datetime, reader: Reader | None) -> Intent:
    """The intent of a wish on a site; what is not understood stands in its `unclear`.

    `now`: with a time zone, in which times are meant. Without a reader only what the words plainly
    say is understood. Raises GatewayError where the model does not answer; an answer that does not
    follow the form is none.
    """
    began = time.monotonic()
    intent = _understood(wish, site, now, reader)
    took = round(1000 * (time.monotonic() - began), 1)
    model = RULES if reader is None else reader.model
    return _with(intent, model, took)


def prompt(text: Text, *, trained: bool) -> Prompt:
    """What a model is asked about a wish."""
    asked = ChatMessage(role="user", content=form.marked(text))
    schema = form.schema(text, wrapped=not trained)
    if trained:
        most = 2 * len(text.mentions) + 6
        return Prompt((asked,), schema, max_tokens=most, certainty=True)
    told = ChatMessage(role="system", content=form.instruction())
    return Prompt((told, asked), schema, max_tokens=16 * len(text.mentions) + 64)


def _understood(wish: str, site: Site, now: datetime, reader: Reader | None) -> Intent:
    if not wish.strip() or len(wish) > MAX_WISH_CHARS:
        return Intent(unclear=(wish.strip()[:QUOTED],))
    text = find(wish, site, now)
    if len(text.mentions) > form.MAX_MENTIONS:
        return Intent(unclear=(wish.strip()[:QUOTED],))
    return compose(text, _read(text, reader), now)


def _read(text: Text, reader: Reader | None) -> Reading:
    plain = rules.read(text)
    if reader is None or plain.final or not text.mentions:
        return settle(text, plain)
    said = _asked(text, reader)
    if said.likely:
        return weighed(text, plain, said)
    return settle(text, agreed(text, plain, said))


def _asked(text: Text, reader: Reader) -> Reading:
    said = reader.read(prompt(text, trained=reader.trained))
    try:
        return form.parse(text, said)
    except ValueError as error:
        why = f"{reader.model} gave no reading of the wish: {error}"
        raise GatewayError("invalid", why) from error


def _with(intent: Intent, model: str, took_ms: float) -> Intent:
    return msgspec.structs.replace(intent, model=model, elapsed_ms=took_ms)
