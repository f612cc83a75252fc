"""Which sequence of the context reads a prompt, so that least is read again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

_SAME = 0.75
"""A prompt that shares this much of what a slot holds replaces it; another prompt gets a copy of
the shared beginning in a slot of its own, so that both can go on."""


@dataclass
class Slot:
    """One sequence of the context."""

    number: int
    tokens: list[int] = field(default_factory=list)
    """What the context holds of it."""
    answer: list[int] = field(default_factory=list)
    """The last answer that was given here: the next one often begins like it."""
    busy: bool = False
    used: int = 0
    """When it was last taken, counted in prompts."""


@dataclass(frozen=True)
class Choice:
    """Where a prompt goes: `source` holds its first `shared` tokens; it may be `target`."""

    target: Slot
    source: Slot
    shared: int


def common(a: Sequence[int], b: Sequence[int]) -> int:
    """How many tokens two sequences begin with in common."""
    for i, (x, y) in enumerate(zip(a, b, strict=False)):
        if x != y:
            return i
    return min(len(a), len(b))


def choose(slots: Sequence[Slot], prompt: Sequence[int]) -> Choice | None:
    """The slot for a prompt; None when all are busy.

    At least the last token is always read again, for the model's answer to it.
    """
    free = [slot for slot in slots if not slot.busy]
    if not free:
        return None
    usable = prompt[:-1]
    shares = {slot.number: common(slot.tokens, usable) for slot in slots}
    source = max(slots, key=lambda slot: (shares[slot.number], not slot.busy, slot.used))
    shared = shares[source.number]
    if not source.busy and shared and shared >= _SAME * len(source.tokens):
        return Choice(source, source, shared)
    return Choice(min(free, key=lambda slot: slot.used), source, shared)
