"""Between an operator's tools and the LLM gateway: a wish in plain words, and what it means."""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.messages.base import Count, Message
from swarm.messages.choices import Operator
from swarm.messages.intent import Intent, Site

MAX_SAID_CHARS = 20_000
"""What is read at all; of a longer wish than `MAX_WISH_CHARS` nothing is understood."""


class WishRequest(Message, frozen=True, kw_only=True):
    """What a person wants, in their own words."""

    request: Count = 0
    operator: Operator = ""
    """Who asks."""
    wish: Annotated[str, msgspec.Meta(max_length=MAX_SAID_CHARS)]
    site: Site
    """The names that it may use."""
    now: Annotated[str, msgspec.Meta(max_length=64, extra_json_schema={"format": "date-time"})]
    """When it was said: ISO 8601 with the time zone in which times are meant."""
    deadline_s: Annotated[float, msgspec.Meta(ge=0.05, le=600)] = 10.0
    """How long the asker waits, from receipt."""


class WishAnswer(Message, frozen=True, kw_only=True):
    """What was understood; nothing of it is in force."""

    request: Count
    understood: Intent
