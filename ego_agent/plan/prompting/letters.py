"""Robots as letters: what an answer to the short prompt is made of."""

from __future__ import annotations

from swarm.messages import Algorithm

Groups = tuple[tuple[Algorithm, int], ...]
"""What may be answered: by the first algorithm so many of the first letters, by the next so many of
those that follow. Nothing: the ego alone."""
ALONE = "alone"
"""The answer that names no helper."""


def letter(at: int) -> str:
    """Of the robot at that place.

    >>> letter(0), letter(2)
    ('A', 'C')
    """
    return chr(ord("A") + at)


def helpers(groups: Groups) -> int:
    """How many take part.

    >>> helpers((("early", 2), ("late", 1)))
    3
    """
    return sum(count for _, count in groups)


def short_answer(groups: Groups) -> str:
    """The text of an answer.

    >>> short_answer((("early", 2), ("late", 1))), short_answer(())
    ('early A B late C', 'alone')
    """
    words: list[str] = []
    at = 0
    for name, count in groups:
        words += [name, *map(letter, range(at, at + count))]
        at += count
    return " ".join(words) or ALONE
