"""Cuts a wish into sentences and clauses, and writes what is named in them in capitals."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from llm_gateway.wishes.clauses.wording import SHORTENED_INSIDE, spelt, whole_cues
from llm_gateway.wishes.cues import asides
from llm_gateway.wishes.cues.common import NOT
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.mentions import POLITE, VERBS, Text
from llm_gateway.wishes.words import text_at

_ENDS = {".", ";", "!", "?", "\n"}
_BREAKS = {",", ":", "–", "—", "(", ")", "-", "and", "but", "und", "aber", "doch", "then", "dann",
           "because", "while", "sondern", "so", "denn", "weil", "though", "although", "as",
           "→", "damit", "whereas", "also", "adn", "udn", "since",
           "dafuer", "plus", "yet", "hingegen", "jedoch", "sowie"}  # fmt: skip
_PARTICLES = {"aber", "doch", "jedoch", "hingegen", "dann", "also", "denn", "though", "however",
              "dafuer"}  # fmt: skip
"""Behind a name alone they go on with its clause: "R2 aber nicht"."""
_MODALS = {"darf", "duerfen", "kann", "koennen", "muessen", "muss", "soll", "sollen", "sollte"}
_SHORTENED = {"approx", "ca", "hoechst", "max", "min", "mind"}
"""Behind them, and before a number, a full stop ends no sentence."""
ARTICLES = {"the", "den", "die", "der", "dem", "das"}
_CAPITALS = {
    "robot": "ROBOT", "place": "PLACE", "class": "CLASS", "share": "SHARE", "time": "TIME",
    "network": "NET", "compute": "CPU", "policy": "POLICY", "unknown": "UNKNOWN",
}  # fmt: skip
_PAIRS = {
    ("a", "o"), ("ab", "zu"), ("again", "again"), ("bread", "butter"), ("by", "large"),
    ("far", "away"), ("first", "foremost"), ("front", "center"), ("front", "centre"),
    ("gang", "gaebe"), ("klipp", "klar"), ("nach", "nach"), ("over", "over"), ("so", "so"),
    ("time", "again"), ("voll", "ganz"),
}  # fmt: skip
"""Words around an "and" that parts nothing: "das A und O"."""
_ENOUGH = {"enough", "genuegt", "genuegts", "reicht", "reichts"}
"""Before "if" they say that this is all that is wished."""
_NOTHING = {"nichts", "nix", "nothing"}
_IS = {"counts", "interessiert", "is", "ist", "matters", "zaehlt"}
_WHICH = {"was", "which", "wofuer", "wonach", "worauf", "worum", "wovor"}
"""Tell of "nothing" what it is: "nichts, worauf man achten muss"."""
_WHO = {"he", "hes", "she", "shes", "theyre", "theyve"}
"""Behind "as" they begin to tell why: "R2 first as he's just been cleaned"."""
_BESIDES = {"&", "+", "and", "sowie", "u", "und"}


@dataclass(frozen=True, slots=True)
class Clause:
    """A part of a wish that says one thing of what it names."""

    text: str
    mentions: tuple[int, ...]
    """Numbers of those that stand in it."""
    sentence: int
    asked: bool
    """Whether its sentence ends in a question mark."""
    opens: bool
    """Whether its sentence begins with it."""
    opener: str
    """The word or sign that parts it from what is before."""
    first: int
    last: int
    """Its words."""
    wished: bool = False
    """Whether its sentence opens as a polite wish: "it would be nice if"."""


def clauses(text: Text) -> list[Clause]:
    """The clauses of a wish, in order."""
    starts = {mention.first: number for number, mention in enumerate(text.mentions)}
    found: list[Clause] = []
    pieces: list[str] = []
    numbers: list[int] = []
    begin, sentence, opens, opener = 0, 0, True, ""
    at = 0
    while at <= len(text.words):
        word = text.words[at].text if at < len(text.words) else "\n"
        number = starts.get(at)
        if number is not None:
            mention = text.mentions[number]
            pieces.append(_capital(mention))
            numbers.append(number)
            at = mention.last
            continue
        ends = word in _ENDS and not (word == "." and _shortens(text, at, pieces))
        if ends or (word in _BREAKS and not _belongs(text, at, pieces)):
            if pieces:
                clause = whole_cues(" ".join(pieces))
                found.append(
                    Clause(clause, tuple(numbers), sentence, word == "?", opens, opener, begin, at)
                )
                opens, opener = False, ""
            if ends:
                sentence += 1
                opens = True
            opener = "" if ends else _opener(opener, word)
            pieces, numbers, begin = [], [], at + 1
        elif word != "," and word not in _ENDS:
            pieces.append(spelt(word))
        at += 1
    asked = {clause.sentence for clause in found if clause.asked}
    wished = {clause.sentence for clause in found if asides.WISHED.search(clause.text)}
    return [
        replace(
            clause,
            text=_bare(clause.text, wished=clause.sentence in wished),
            asked=clause.sentence in asked,
            wished=clause.sentence in wished,
        )
        for clause in found
    ]


def _opener(before: str, word: str) -> str:
    """What opens a clause behind two that part it: "then" tells more than a comma or "and"."""
    weak = {"", ",", "and", "und"} if word in {"dann", "then"} else {"", ","}
    return word if before in weak else before


def _bare(text: str, *, wished: bool) -> str:
    """A clause without what only says who wishes, or how politely."""
    plain = asides.RELAYED.sub("", text)
    if wished:
        plain = asides.WHETHER.sub("", asides.WISHED.sub("", plain).strip())
    return plain.strip()


def _capital(mention: Mention) -> str:
    return _CAPITALS[mention.kind]


def _shortens(text: Text, at: int, pieces: list[str]) -> bool:
    """Whether full stop `at` only ends a short form: "min. 0.8", but not "0.8 min. R2 out"."""
    if text_at(text.words, at - 1) in SHORTENED_INSIDE:
        return True
    if pieces[-1:] == [] or pieces[-1] not in _SHORTENED or pieces[-2:-1] == ["SHARE"]:
        return False
    counted = any(m.first == at + 1 and m.kind in ("share", "time") for m in text.mentions)
    return counted or any(word.text[0].isdigit() for word in text.words[at + 1 : at + 2])


def _belongs(text: Text, at: int, pieces: list[str]) -> bool:
    """Whether a word that parts clauses belongs to "all but", "as little", "low-priority"."""
    word = text.words[at].text
    before = " ".join(pieces[-3:])
    alone = set(pieces) - ARTICLES
    things = {"ROBOT", "PLACE", "CLASS"}
    if word in _PARTICLES and len(alone & things) == 1 and alone <= things | _MODALS:
        return all(mention.first != at + 1 for mention in text.mentions)
    if word == "sowie" and (at == 0 or text.words[at - 1].text in _ENDS):
        return True  # "As soon as".
    if word in {"dann", "then"} and pieces in (["erst"], ["nur"], ["only"]):
        behind = [said.text for said in text.words[at + 1 : at + 3]]
        return bool({*behind} & {"anderen", "others", "rest"})  # "Only then the others".
    if word == "but":
        return bool(re.search(r"\b(?:all|every\w*|any\w*|nobody|no ?one|none|nothing|ones|robots?|"
                              r"others?|else|them)$", before))  # fmt: skip
    following = text.words[at + 1].text if at + 1 < len(text.words) else ""
    if (pieces[-1:] or [""])[0] and (pieces[-1], following) in _PAIRS:
        return True
    if word == "as" and following in {"long", "soon"}:
        return True
    if word in _BESIDES and _beside(text, at, pieces):
        return True
    if word == "-" and 0 < at < len(text.words) - 1:
        touches = text.words[at - 1].end == text.words[at].start
        return touches or text.words[at].end == text.words[at + 1].start
    if word == ",":
        # What is wished of "that R3 is asked" stands before it.
        supposed = following in {"if", "ob", "wenn"}
        if pieces[:1] and pieces[0] in _NOTHING and following in _IS and len(pieces) > 1:
            return True  # "Nichts, was am Tor passiert, ist wichtig".
        nothing = pieces[-1:] in (["nichts"], ["nix"], ["nothing"])
        if supposed and _ENOUGH & {*pieces}:
            return True
        return (
            following in {"dass", "that"}
            or (nothing and following in _WHICH)
            or (
                supposed
                and not {"ROBOT", "PLACE", "CLASS"} & {*pieces}
                and bool(asides.SUBJUNCTIVE.search(" ".join(pieces)))
            )
        )
    if word == "so":
        measured = {
            "good",
            "grateful",
            "kind",
            "nice",
            "nett",
            "lieb",
            "freundlich",
            "much",
            "many",
            "far",
            "long",
            "viel",
            "viele",
            "wenig",
            "lange",
            "oft",
            "often",
            "hard",
            "quickly",
            "schnell",
            "haeufig",
            "gut",
        }
        behind = pieces[-2:] if pieces[-1:] == ["mehr"] else pieces[-1:]
        return any(NOT.fullmatch(word) for word in behind) or following in measured
    if word == "since":
        return any(mention.first <= at < mention.last for mention in text.mentions)
    tells = following in _WHO and not {"as", "so", "soon", "long", "same", "such"} & {*pieces}
    return word == "as" and at > 0 and text.words[at - 1].text not in {",", "."} and not tells


def _beside(text: Text, at: int, pieces: list[str]) -> bool:
    """Whether "and" joins a place and a class: "people and the ramp" share what is said of them."""
    if pieces[-1:] not in (["PLACE"], ["CLASS"], ["UNKNOWN"]):
        return False
    behind = at + 1
    while behind < len(text.words) and text.words[behind].text in ARTICLES:
        behind += 1
    after = next((mention for mention in text.mentions if mention.first == behind), None)
    joined = {"robot"} if pieces[-1] == "UNKNOWN" else {"place", "class"}
    if after is None or after.kind not in joined:
        return False
    follows = text.words[after.last].text if after.last < len(text.words) else ""
    said = set(pieces[:-1]) - ARTICLES - POLITE
    return not (said and follows in VERBS)
