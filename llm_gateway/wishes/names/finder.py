"""Finds the one thing that a wish names from a word on."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.classes import Classes
from llm_gateway.wishes.names.cut import Cut
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.numbered import Numbered
from llm_gateway.wishes.names.places import Places
from llm_gateway.wishes.names.policies import Policies
from llm_gateway.wishes.names.roster import Roster
from llm_gateway.wishes.numbers import tens_behind
from llm_gateway.wishes.shares import is_torn, share_at
from llm_gateway.wishes.times.phrases import when_at
from llm_gateway.wishes.times.when import When
from llm_gateway.wishes.words import Word, alike
from swarm.messages.intent import Site

_EXCEPT = {"ausgenommen", "ausser", "barring", "except", "excepting"}
_CLAUSE = 6
"""Words behind "rechnet" that say how."""
_TURNS = {"", ",", "aber", "and", "but", "just", "nur", "only", "und"}
"""Before "not" and a time."""


class Finder:
    """Looks at one wish on one site."""

    def __init__(self, wish: str, cut: Sequence[Word], site: Site) -> None:
        self._words = cut
        self._cut = Cut(cut)
        self._text = self._cut.text
        self._roster = Roster(self._cut, site.robots)
        self._numbered = Numbered(wish, cut, site)
        self._classes = Classes(wish, cut, site.classes)
        self._places = Places(cut, site, self._roster, self._classes)
        self._policies = Policies(cut)
        self._behind = 0

    def at(self, at: int, now: datetime) -> Mention | None:
        """What is named from word `at` on; to be asked for in order."""
        found = self._at(at, now)
        if found is not None and is_torn(self._words, at, self._behind):
            found = Mention("unknown", at, found.last)
        if found is not None and found.kind in ("place", "robot"):
            found = self._whole(found)
        if found is not None:
            self._behind = found.last
        if found is not None and found.kind == "robot":
            self._numbered.see(found.names)
        if found is not None and found.kind == "place":
            self._places.see(found.names)
        return found

    def _whole(self, found: Mention) -> Mention:
        """What is named, unknown where its number may go on: "Roboter zwei und zwanzig"."""
        for at in range(found.first, found.last):
            apart = tens_behind(self._words, at)
            if apart is not None:
                return Mention("unknown", found.first, max(found.last, apart[1]))
        return found

    def _at(self, at: int, now: datetime) -> Mention | None:
        return (
            self._places.at(at)
            or self._roster.at(at)
            or self._numbered.at(at, self._places.seen)
            or self._when(at, now)
            or self._share(at)
            or self._classes.at(at)
            or self._plain(at)
            or self._places.again(at)
            or self._places.stranger(at)
        )

    def _when(self, at: int, now: datetime) -> Mention | None:
        when = when_at(self._words, at, now)
        if when is None:
            return None
        if self._text(at - 1) in _EXCEPT or (
            self._text(at - 1) in {"not", "nicht"} and self._text(at - 2) in _TURNS
        ):
            # "Except between six and seven", "but not until six".
            when = When(at, when.last, clear=False)
        return Mention("time", at, when.last, when=when)

    def _share(self, at: int) -> Mention | None:
        share = share_at(self._words, at)
        return None if share is None else Mention("share", at, share.last, share=share)

    def _plain(self, at: int) -> Mention | None:
        text = self._text(at)
        articles = {"the", "our", "this", "that", "your", "on"}
        if text == "net" and not articles & {self._text(at - 1), self._text(at - 2)}:
            return None  # "Nicht" in the south.
        one = text.removesuffix("s")
        slip = alike(text, "bandwidth") or alike(text, "bandbreite")
        if text == "links" and self._text(at + 1) == "liegen":
            return None  # "Links liegen lassen".
        if {text, one} & lexicon.NETWORK or slip or lexicon.NETWORKS.fullmatch(text):
            return Mention("network", at, at + 1)
        computes = self._computing(at)
        if computes is not None:
            return Mention("compute", at, computes)
        near = {self._text(n) for n in range(at - 3, at + 4)}
        with_it = self._text(at - 2) == "mit" and self._text(at - 1) == "dem"  # "Dem Senden".
        if text in lexicon.SENDING and (near & lexicon.LITTLE or with_it or self._too_much(at)):
            return Mention("network", at, at + 1)
        if text in lexicon.ENERGY and near & lexicon.SAVING:
            return Mention("compute", at, at + 1)
        return self._policies.at(at)

    def _too_much(self, at: int) -> bool:
        """Whether the words behind word `at` forbid so much of it: "funkt nicht so viel"."""
        said = [self._text(n) for n in range(at + 1, at + _CLAUSE)]
        return any(
            said[n] in lexicon.NOT and said[n + 1 : n + 3] == ["so", "viel"]
            for n in range(len(said))
        )

    def _computing(self, at: int) -> int | None:
        """The word behind what computes, or the computing."""
        text = self._text(at)
        last = at + 1 + (self._text(at + 1) == "-")
        if text in lexicon.GRAPHICS and self._text(last).removesuffix("s") == "card":
            return last + 1
        if text == "edge" and self._text(last) in lexicon.EDGE and self._classes.at(last) is None:
            return last + 1
        room = text in {"server", "servers"} and self._text(last) in lexicon.ROOMS
        known_so = {text, text.removesuffix("s")} & lexicon.COMPUTE and not room
        behind = {self._text(n) for n in range(at + 1, at + _CLAUSE)}
        sparing = (behind | {self._text(at - 1)}) & lexicon.SPARINGLY or self._too_much(at)
        sparingly = sparing and "mit" not in behind
        if known_so or lexicon.COMPUTERS.fullmatch(text):
            return at + 1
        return at + 1 if text in lexicon.CALCULATING and sparingly else None
