"""What a wish names: one thing, of one kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from llm_gateway.wishes.shares import Share
from llm_gateway.wishes.times.when import When

Kind = Literal[
    "robot", "place", "class", "share", "time", "network", "compute", "policy", "unknown"
]


@dataclass(frozen=True, slots=True)
class Mention:
    """Something that a wish names, from word `first` up to, not including, word `last`."""

    kind: Kind
    first: int
    last: int
    names: tuple[str, ...] = ()
    """The site's own; the policy's."""
    share: Share | None = None
    when: When | None = None
