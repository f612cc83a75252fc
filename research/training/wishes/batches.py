"""What is learned from, as tokens: prompts in the model's chat format, and the answers behind."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch

from llm_gateway.backends.llamacpp.native import Native
from swarm.messages import ChatMessage

POOL = 40
"""Batches among which examples of like length are put together."""


@dataclass(frozen=True, slots=True)
class Lesson:
    """One example."""

    tokens: tuple[int, ...]
    answer: int
    """Number of the answer's first token; only from there on something is learned."""


def lesson(native: Native, messages: Sequence[ChatMessage], answer: str) -> Lesson:
    """The tokens that the engine would read and write, the end of the answer included."""
    prompt = native.chat(messages)
    said = native.tokens(answer, special=False)
    end = native.tokens("<|im_end|>", special=True)
    return Lesson((*prompt, *said, *end), len(prompt))


@dataclass(frozen=True, slots=True)
class Batch:
    """Padded on the right; all of shape (examples, tokens)."""

    tokens: torch.Tensor
    learned: torch.Tensor
    """Where the next token is to be learned."""


def batches(lessons: Sequence[Lesson], size: int, chance: random.Random) -> Iterator[Batch]:
    """Every lesson once, in random order, those of like length together."""
    order = list(range(len(lessons)))
    chance.shuffle(order)
    for at in range(0, len(order), size * POOL):
        pool = sorted(order[at : at + size * POOL], key=lambda n: len(lessons[n].tokens))
        parts = [pool[i : i + size] for i in range(0, len(pool), size)]
        chance.shuffle(parts)
        for part in parts:
            yield _batch([lessons[n] for n in part])


def _batch(lessons: Sequence[Lesson]) -> Batch:
    longest = max(len(one.tokens) for one in lessons)
    tokens = torch.zeros(len(lessons), longest, dtype=torch.long)
    learned = torch.zeros_like(tokens, dtype=torch.bool)
    for row, one in enumerate(lessons):
        tokens[row, : len(one.tokens)] = torch.tensor(one.tokens)
        learned[row, one.answer - 1 : len(one.tokens) - 1] = True
    return Batch(tokens, learned)
