"""Finds the policies that a wish names, some of which have plain words for names."""

from __future__ import annotations

from collections.abc import Sequence

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.cut import Cut
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.times.clock import point_at
from llm_gateway.wishes.times.lengths import length_at
from llm_gateway.wishes.words import Word

_NAMES = (*lexicon.PLAIN_POLICIES.items(), *lexicon.POLICIES.items())
_NAMELESS = {"policy", "strategie", "strategy"}
"""Said of a policy even from afar."""
_ENDS = {"", ".", "!", "?", ";", ":", ",", "\n", "→", ")"}
_DASHES = {"-", "–", "—"}
_OPENS = _ENDS - {")"} | _DASHES | {"(", "and", "bitte", "dann", "please", "plus", "then", "und",
                                    "wieder"}  # fmt: skip
"""Before a name alone, as in a list of wishes."""
_CLOSES = (
    _ENDS
    | _DASHES
    | frozenset(
        """ab again and bis bitte for from fuer heute jetzt mit mode modus now only please pls plus
    thanks till today und until wieder with""".split()
    )
)
"""Behind a name alone."""
_TIMES = {"ab", "bis", "from", "till", "until"}
_LASTS = {"for", "fuer"}
_BACK = {"back", "change", "go", "return", "switch", "zurueck"}
_TO = {"auf", "to", "zu"}
_GOES = {"gehen", "geht", "wechseln", "wechselt"}
"""Behind "auf" and a name: "auf coverage gehen"."""
_OF = {"of", "at", "in", "on", "near"}
"""Behind "coverage" they make a plain word of it."""
_KINDS = frozenset(
    """all area bad bessere best beste better camera complete enough fi floor full good gute kamera
    lidar maximum mehr more netz network our poor radio sensor sensors the thin total unsere volle
    wide wifi wlan""".split()
)
"""Before "coverage" they say that it is of something."""
_SAID = {"for", "fuer", "gaps", "has", "hat", "here", "hole", "holes", "is", "ist", "there", "was",
         "war", "wird"}  # fmt: skip
"""Behind "coverage" they say how good it is, or of what."""
_RUN = {"fahr", "fahre", "fahren", "fahrt", "let", "run", "start"}
"""Before a name they say that it decides, be it "on the ego"."""
_SWAPS = {"als", "anstatt", "instead", "replace", "statt", "than", "with"}
"""Between two policies they say which one is to decide."""
_TURNS = {"but", "kein", "keine", "nicht", "no", "not", "sondern"}
"""So they do right before the second one, or the first."""
_SWITCHED = {"active", "aktiv", "an", "aus", "ein", "off", "on", "raus", "rein", "weg"}
"""Behind a name, and before an end, they switch it on or off."""


class Policies:
    """Looks for policies in one wish."""

    def __init__(self, words: Sequence[Word]) -> None:
        self._words = words
        self._cut = Cut(words)
        self._text = self._cut.text
        self._seen: set[str] = set()

    def at(self, at: int) -> Mention | None:
        """The policy that is named from word `at` on; unknown where that is doubtful."""
        found = self._name(at)
        if found is None:
            return None
        policy, last, plain = found
        switched = self._text(last) in _SWITCHED and self._text(last + 1) in _CLOSES
        timed = self._text(last) == "at" and point_at(self._words, last + 1) is not None
        swapped = self._text(at - 1) in _TO and self._beside(at)
        of_it = self._text(last) in _OF and self._text(at - 1) not in _RUN
        if of_it and not (switched or plain or timed or swapped):
            return None  # "Better coverage of the docks" names no policy.
        if plain or switched or swapped or self._alone(at, last) or self._told(at, policy):
            self._seen.add(policy)
            return Mention("policy", at, last, (policy,))
        # "Coverage" is a plain word, too; what is meant by the others has to be asked.
        doubted = self._text(at - 1) not in _KINDS and self._text(last) not in _SAID
        return Mention("unknown", at, last) if policy != "coverage" or doubted else None

    def _name(self, at: int) -> tuple[str, int, bool] | None:
        """The policy, the word behind its name, and whether this means nothing else."""
        hits = {
            end: (policy, name in lexicon.PLAIN_POLICIES.get(policy, ()))
            for policy, names in _NAMES
            for name in names
            if (end := self._cut.named(name.split(), at, also=False)) is not None
        }
        return (hits[max(hits)][0], max(hits), hits[max(hits)][1]) if hits else None

    def _told(self, at: int, policy: str) -> bool:
        """Whether words near a name say that a policy is meant."""
        near = {self._text(n) for n in range(at - 5, at + 6)}
        near |= {self._text(n) for n in range(at - 9, at + 10)} & _NAMELESS
        taken = {self._text(n) for n in range(at - 3, at + 4)} & lexicon.TAKE
        if taken or near & lexicon.POLICY_WORDS or policy in self._seen:
            return True
        swapped = near & _SWAPS or self._text(at - 1) in _TURNS
        return (policy != "coverage" or bool(swapped)) and self._beside(at)

    def _beside(self, at: int) -> bool:
        """Whether another policy is named near."""
        names = (self._name(n) for n in range(max(0, at - 6), at + 7) if n != at)
        mine = self._name(at)
        return any(
            found is not None and mine is not None and found[0] != mine[0] for found in names
        )

    def _alone(self, at: int, last: int) -> bool:
        """Whether a policy's name is a wish of its own, but for a time: "Coverage ab drei"."""
        before, behind = self._text(at - 1), self._text(last)
        if behind in _TIMES and point_at(self._words, last + 1) is None:
            return False
        if behind in _LASTS and length_at(self._words, last + 1) is None:
            return False
        if before in _TO and (self._text(at - 2) in _BACK or behind in _GOES):
            return True
        starts = before in {"", ".", "!", "?", ";", "\n"}
        listed = before in _OPENS and behind in _CLOSES - {",", "and", "und"}
        return behind in _CLOSES and (starts or listed)
