"""Robots as letters: what an answer to the short prompt is made of."""

from __future__ import annotations

from swarm.messages import Algorithm

ALONE = "alone"
"""The answer that names no helper."""


def letter(at: int) -> str:
    """Of the robot at that place.

    >>> letter(0), letter(2)
    ('A', 'C')
    """
    return chr(ord("A") + at)


def short_answer(algorithm: Algorithm, helpers: int) -> str:
    """The answer that takes the first so many.

    >>> short_answer("early", 2), short_answer("early", 0)
    ('early A B', 'alone')
    """
    if not helpers:
        return ALONE
    return " ".join((algorithm, *map(letter, range(helpers))))
