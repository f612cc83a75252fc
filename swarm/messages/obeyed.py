"""What an ego says of the intents that it obeys: which, since when, by whom, and what they do."""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.messages.base import Bounded, Count, Ns, RobotId
from swarm.messages.choices import Operator
from swarm.messages.intent import MAX_NAMES, Intent, Name, Words
from swarm.messages.llm import NonNegative

MAX_INTENTS = 16
"""In force or waiting, of one ego: more than anybody keeps in mind."""
MAX_SENTENCE = 2_000
Sentence = Annotated[str, msgspec.Meta(max_length=MAX_SENTENCE)]
Corner = tuple[Bounded, Bounded]
Polygon = Annotated[tuple[Corner, ...], msgspec.Meta(min_length=3, max_length=64)]
"""Corners in order, x and y in the world frame, metres."""


class Place(msgspec.Struct, frozen=True):
    """A part of the floor with a name; several with one name are one place."""

    name: Name
    polygon: Polygon


Places = Annotated[tuple[Place, ...], msgspec.Meta(max_length=MAX_NAMES)]


class IntentInForce(msgspec.Struct, frozen=True, kw_only=True):
    """A confirmed intent."""

    number: Count
    """The ego's own count of its intents, from 1."""
    intent: Intent
    operator: Operator = ""
    """Who confirmed it."""
    since_ns: Ns = 0
    """When it was confirmed, on the ego's clock."""
    wish: Words = ""
    """The person's own words; empty where there were none."""
    places: Places = ()
    """Those that it names."""


class IntentTold(msgspec.Struct, frozen=True, kw_only=True):
    """An intent in one decision."""

    number: Count
    operator: Operator
    since_ns: Ns
    until: Annotated[str, msgspec.Meta(max_length=64)] | None
    """As it was given; None: until it is withdrawn."""
    says: Sentence
    """What is wished, read back."""
    bound: tuple[Sentence, ...] = ()
    """What it did to this decision, one sentence each."""


class Expected(msgspec.Struct, frozen=True, kw_only=True):
    """What an ego would have decided, as a mean over decisions."""

    participants: NonNegative
    """Besides the ego."""
    robots: dict[RobotId, NonNegative]
    """In which share of the decisions each one takes part."""
    bytes_s: NonNegative
    """Of observations."""
    quality: NonNegative
    """Q, in which every place and class counts alike."""
    seen: dict[Name, NonNegative] = msgspec.field(default_factory=dict)
    """What the choice sees of each place, in the share of what all could see there."""


class Effect(msgspec.Struct, frozen=True, kw_only=True):
    """The decisions of the last minute, made again without and with an intent."""

    decisions: Count
    """How many of them; 0: none had been made."""
    span_s: NonNegative
    policy: str
    """By which they were made again."""
    before: Expected | None = None
    after: Expected | None = None
    nobody: bool = False
    """The intent leaves nobody to ask who was asked before."""
