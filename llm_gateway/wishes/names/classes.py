"""Finds the kinds of objects that a wish names."""

from __future__ import annotations

from collections.abc import Sequence

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.names.cut import LEADS, LIST, Cut
from llm_gateway.wishes.names.forms import called
from llm_gateway.wishes.names.mention import Kind, Mention
from llm_gateway.wishes.names.people import CALLED, ENDS, SPEAKS, TITLES
from llm_gateway.wishes.tongue import is_german_noun
from llm_gateway.wishes.words import Word, key

_GREETINGS = {"hello", "hi", "hey", "dear", "hallo", "liebe", "liebes", "geehrte", "geehrter",
              "geehrten", "moin", "servus", "thanks",
              "danke"}  # fmt: skip
"""Whom they greet is nobody whom the detector finds."""
_LEAST_JOINED = 3
"""Letters of the second word of two that are one."""


class Classes:
    """Looks for kinds of objects in one wish."""

    def __init__(self, wish: str, cut: Sequence[Word], classes: Sequence[str]) -> None:
        self._wish = wish
        self._words = cut
        self._cut = Cut(cut)
        self._text = self._cut.text
        self._classes = {key(name): name for name in classes}

    def at(self, at: int) -> Mention | None:
        """The class that is named from word `at` on; unknown where it may be another."""
        hits = {}
        if self._text(at - 1) in _GREETINGS or self._calls(at):
            return None
        for name, label in self._classes.items():
            end = self._cut.named(name, at, also=False)
            if end is not None:
                hits[label] = end
        joined = self._joined(at)
        hits = joined if max(joined.values(), default=0) > max(hits.values(), default=0) else hits
        if not hits and (
            self._text(at) != "personal" or is_german_noun(self._words, at, self._wish)
        ):
            said = self._text(at)
            hits = {k: at + 1 for n, k in self._classes.items() if called(said, " ".join(n))}
        if not hits:
            return None
        end = max(hits.values())
        best = [label for label, last in hits.items() if last == end]
        if len(best) > 1:
            best = [b for b in best if b == self._text(at)] or best
        kind: Kind = "class" if len(best) == 1 else "unknown"
        return Mention(kind, at, end, tuple(best) if kind == "class" else ())

    def _joined(self, at: int) -> dict[str, int]:
        """Classes by what people call them, written as two words: "van carrier"."""
        last = at + 1 + (self._text(at + 1) == "-")
        said = self._text(last)
        if len(said) < _LEAST_JOINED or not said.isalpha():
            return {}
        both = self._text(at) + said
        return {k: last + 1 for n, k in self._classes.items() if called(both, " ".join(n))}

    def _calls(self, at: int) -> bool:
        """Whether somebody is called so, and nothing is wished: "thanks, folks", "Frau Yilmaz"."""
        text, before, behind = self._text(at), self._text(at - 1), self._text(at + 1)
        if text in TITLES and behind.isalpha() and not known(behind):
            return self._wish[self._words[at + 1].start].isupper()
        opens = before in {"", ".", "!", "?"} and behind in {",", "!"}
        if behind in SPEAKS:
            return True
        closes = before == "," and behind in {"", ".", "!"}
        ends = text in ENDS and behind in {"", ".", "!"} and before not in LEADS | LIST
        return ends or (text in CALLED and (opens or closes))
