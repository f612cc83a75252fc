"""Slips of the keyboard and habits of writing, which change no meaning."""

from __future__ import annotations

import random
from dataclasses import replace

from research.training.wishes.grammar import Piece

_NEAR = {
    "a": "sq", "b": "vn", "c": "xv", "d": "sf", "e": "wr", "f": "dg", "g": "fh", "h": "gj",
    "i": "uo", "k": "jl", "l": "ko", "m": "n", "n": "bm", "o": "ip", "r": "et", "s": "ad",
    "t": "ry", "u": "yi", "w": "qe",
}  # fmt: skip


def noisy(pieces: list[Piece], chance: random.Random) -> list[Piece]:
    """The pieces as a hurried person would type them; names and times keep their spelling."""
    if chance.random() < 0.12:
        pieces = [replace(p, text=_slip(p.text, chance)) if p.role is None else p for p in pieces]
    if chance.random() < 0.25:
        pieces = [replace(p, text=p.text.lower()) for p in pieces]
    elif chance.random() < 0.03:
        pieces = [replace(p, text=p.text.upper()) for p in pieces]
    elif pieces and chance.random() < 0.6:
        first = pieces[0]
        pieces = [replace(first, text=first.text[:1].upper() + first.text[1:]), *pieces[1:]]
    if chance.random() < 0.3 and not pieces[-1].text.endswith(("?", "!", ".")):
        pieces = [*pieces, Piece(chance.choice((".", ".", "!")))]
    if chance.random() < 0.1:
        pieces = [replace(p, text=_bare(p.text)) for p in pieces]
    return pieces


def _slip(text: str, chance: random.Random) -> str:
    """One slip in about every third word of more than three letters."""
    words = text.split(" ")
    for number, word in enumerate(words):
        if len(word) > 3 and word.isalpha() and chance.random() < 0.33:
            at = chance.randrange(1, len(word) - 1)
            match chance.randrange(4):
                case 0:
                    word = word[:at] + word[at + 1 :]
                case 1:
                    word = word[:at] + word[at] + word[at:]
                case 2:
                    word = word[:at] + word[at + 1] + word[at] + word[at + 2 :]
                case _:
                    near = _NEAR.get(word[at].lower(), word[at])
                    word = word[:at] + chance.choice(near) + word[at + 1 :]
            words[number] = word
    return " ".join(words)


def _bare(text: str) -> str:
    """Without umlauts and apostrophes."""
    for mark, plain in (("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("ß", "ss"), ("'", "")):
        text = text.replace(mark, plain)
    return text
