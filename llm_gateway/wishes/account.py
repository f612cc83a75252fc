"""Accounts for what a wish says: what has no role, and must have one, is asked back."""

from __future__ import annotations

from dataclasses import replace

from llm_gateway.wishes import lexicon
from llm_gateway.wishes.mention import Mention
from llm_gateway.wishes.mentions import Text
from llm_gateway.wishes.reading import Reading
from llm_gateway.wishes.times import LEFT


def settle(text: Text, reading: Reading) -> Reading:
    """A reading in which whatever must be accounted for and is not is unclear."""
    unclear = [*reading.unclear, *_unread(text)]
    for mention, role in zip(text.mentions, reading.roles, strict=True):
        told = role == "none" and mention.kind in ("robot", "place", "class", "share", "unknown")
        if told and mention.kind == "share" and _is_told(text, mention):
            continue
        if role == "doubt" or told:
            unclear.append(_question(text, mention))
    return replace(reading, unclear=tuple(dict.fromkeys(unclear)))


def _question(text: Text, mention: Mention) -> str:
    """The words in doubt, and what to ask about them where code knows."""
    said = text.said(mention.first, mention.last)
    asked = "" if mention.when is None else mention.when.question
    return f"{said} {asked}".strip()


def _unread(text: Text) -> list[str]:
    """Words of times and numbers that belong to nothing that was found; and what is to come only
    after something else."""
    inside = {at for m in text.mentions for at in range(m.first, m.last)}
    timed = any(m.when is not None and (m.when.until or m.when.lasts) for m in text.mentions)
    found = []
    for at, word in enumerate(text.words):
        if at in inside:
            continue
        later = timed and word.text in {"then", "dann", "danach", "afterwards", "anschliessend"}
        until = word.text == "bis" and text.words[min(at + 1, len(text.words) - 1)].text not in {
            "auf",
            "zu",
        }
        if word.text in LEFT or word.text.isdigit() or until or later:
            found.append(text.said(at, min(at + 4, len(text.words))))
    return found


def _is_told(text: Text, mention: Mention) -> bool:
    """Whether a part is a battery's."""
    near = text.words[max(0, mention.first - 6) : mention.last + 4]
    return bool({word.text for word in near} & lexicon.BATTERY)
