"""Finds what a wish names: robots, places, classes, parts, times, the network, policies."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime

from llm_gateway.wishes.cues import robots
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.cut import LIST
from llm_gateway.wishes.names.finder import Finder
from llm_gateway.wishes.names.mention import Kind, Mention
from llm_gateway.wishes.words import Word, words
from swarm.messages.intent import Site

_ARTICLES = {"the", "teh", "hte", "den", "die", "der", "dem", "das"}
VERBS = frozenset(
    """i we you is isnt are arent can cant cannot do dont does doesnt should shouldnt may must stays
    stay needs need not no kann koennen darf duerfen ist sind bleibt bleiben soll sollen muss
    muessen interessiert interessieren nicht nich ned kein egal ich wir ihr brauchen brauche
    brauchts gehen geht matter matters dagegen less weniger please bitte""".split()
)
"""Behind a name they begin to say something of it alone."""
_ONE_DOES = {"bleibt", "darf", "geht", "gets", "goes", "is", "isnt", "ist", "kann", "muss", "needs",
             "soll", "stays"}  # fmt: skip
_ASKS = {"ask", "asks", "dann", "first", "frag", "fragt", "nutzt", "query", "then", "use",
         "verwendet", "zuerst"}  # fmt: skip
_OUT = {"aus", "never", "nie", "off", "out", "raus", "weg"}
"""Behind a second list they say the opposite of what these say before the first."""
_MODALS = {"can", "cant", "may", "must", "mustnt", "should", "shouldnt", "will", "wont"}
_ACTS = (robots.OUT, robots.FIRST, robots.UNUSED, re.compile("but|except|just|nur|only"))
"""Before a list they wish something of it."""
_BESIDES = {"ausser", "ohne", "without"}
"""Before a list they go with the verb behind it: "ohne R1 und R2 geht es"."""
POLITE = {"please", "bitte", "hi", "hello", "hey", "hallo", "ok", "okay", *_ARTICLES}


QUOTED = 200
"""Characters of a wish that are told."""


@dataclass(frozen=True, slots=True)
class Text:
    """A wish, its words, and what it names, in order and apart."""

    wish: str
    words: tuple[Word, ...]
    mentions: tuple[Mention, ...]

    @property
    def whole(self) -> str:
        """The wish as it is asked back: its first QUOTED characters."""
        return self.wish.strip()[:QUOTED]

    def capitals(self, *kinds: Kind) -> str:
        """Its words and signs, with the kind of what it names in capitals; of these kinds, if any
        is given."""
        named = {m.first: m for m in self.mentions if not kinds or m.kind in kinds}
        pieces, at = [], 0
        while at < len(self.words):
            found = named.get(at)
            pieces.append(self.words[at].text if found is None else found.kind.upper())
            at = at + 1 if found is None else found.last
        return " ".join(pieces)

    def said(self, first: int, last: int) -> str:
        """The wish's own characters from word `first` up to, not including, word `last`."""
        return self.wish[self.words[first].start : self.words[last - 1].end] if first < last else ""


def find(wish: str, site: Site, now: datetime) -> Text:
    """What a wish names. `now`: with a time zone."""
    cut = words(wish)
    finder = Finder(wish, cut, site)
    found: list[Mention] = []
    at = 0
    while at < len(cut):
        mention = finder.at(at, now)
        if mention is None:
            at += 1
        else:
            found.append(mention)
            at = mention.last
    return Text(wish, tuple(cut), tuple(_joined(cut, found)))


def _joined(cut: Sequence[Word], found: Sequence[Mention]) -> Iterator[Mention]:
    """Lists of one kind are one mention: they share their fate."""
    held: Mention | None = None
    for mention in found:
        if (
            held is not None
            and held.kind == mention.kind
            and mention.kind in ("robot", "place", "class")
            and _glued([word.text for word in cut[held.last : mention.first]], mention.kind)
            and not _parted(cut, held, mention)
        ):
            names = tuple(dict.fromkeys((*held.names, *mention.names)))
            held = Mention(mention.kind, held.first, mention.last, names)
            continue
        if held is not None:
            yield held
        held = mention
    if held is not None:
        yield held


def _glued(between: Sequence[str], kind: Kind) -> bool:
    """Whether only list signs stand between two names."""
    fillers = lexicon.ROBOT_WORDS | _ARTICLES if kind == "robot" else _ARTICLES
    return set(between) <= LIST | fillers and (bool(set(between) & LIST) or not between)


def _parted(cut: Sequence[Word], held: Mention, mention: Mention) -> bool:
    """Whether a comma between two names begins another clause: "skip R1, R2 is fine"."""
    between = {word.text for word in cut[held.last : mention.first]} - _ARTICLES
    if mention.kind == "robot" and not {*held.names}.isdisjoint(mention.names):
        return True
    if mention.last == len(cut) or not held.first:
        return False
    opens = held.first - 1
    while opens > 0 and cut[opens].text in _ARTICLES:
        opens -= 1
    before, behind = cut[opens].text, cut[mention.last].text
    if before in _BESIDES:
        return False
    if mention.kind == "robot" and not between.isdisjoint({"and", "und"}):
        verbs = _ONE_DOES | _MODALS if "," in between else _ONE_DOES
        return behind in verbs and any(cue.fullmatch(before) for cue in _ACTS)
    if between <= {",", "-", "–"} and before in _ASKS and behind in _OUT:
        return True
    parts = between == {","} and behind in VERBS
    return parts and before.isalpha() and before not in {"and", "und", "so", *POLITE}
