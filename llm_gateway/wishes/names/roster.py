"""Finds the robots that a wish names: one, a list, a range, by numbers, or all of a kind."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.cut import LIST, Cut
from llm_gateway.wishes.names.families import families, family_at
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.numbers import whole
from llm_gateway.wishes.words import key

_RANGE = {"to", "through", "thru", "bis", "-", "–", ".."}
_NUMBERED = re.compile(r"\d+")
_COMPARES = {"als", "before", "than", "vor"}
_FAMILY = 4
"""Words of "all of the scouts"."""


class Roster:
    """The robots of a site, as they are looked for in one wish."""

    def __init__(self, cut: Cut, robots: Sequence[str]) -> None:
        self._cut = cut
        self._families = families(robots)
        self._robots = {key(name): name for name in robots}
        self._numbers = {
            digits[0].lstrip("0"): name
            for name in robots
            if len(digits := _NUMBERED.findall(name)) == 1
        }
        heads = {k[0] for k in self._robots if len(k) == 2 and k[0].isalpha()}
        self._prefixes = heads | {head + "s" for head in heads if len(head) > 1}

    def at(self, at: int) -> Mention | None:
        """The robots that are named from word `at` on."""
        return self._robot(at) or self._family(at)

    def _robot(self, at: int) -> Mention | None:
        for name, robot in sorted(self._robots.items(), key=lambda item: -len(item[0])):
            end = self._cut.named(name, at, also=False)
            if end is not None and not self._cut.text(end).isdigit():
                return self._more(self._range(Mention("robot", at, end, (robot,))))
        if self._cut.text(at) in self._prefixes:
            sign = 1 if self._cut.text(at + 1) in {"-", "_"} else 0
            digits = self._cut.text(at + 1 + sign).lstrip("0")
            if self._cut.text(at + 1 + sign).isdigit():
                robot = self._numbers.get(digits, "")
                names = (robot,) if robot else ()
                found = Mention("robot" if robot else "unknown", at, at + 2 + sign, names)
                return self._more(found) if robot else found
        if self._cut.text(at) in lexicon.ROBOT_WORDS:
            return self._counted(at)
        return None

    def _range(self, mention: Mention) -> Mention:
        """R1 to R4, where all of them exist."""
        if self._cut.text(mention.last) not in _RANGE:
            return mention
        other = self._robot_alone(mention.last + 1)
        if other is None:
            return mention
        low, high = (_NUMBERED.findall(name) for name in (mention.names[0], other.names[0]))
        if len(low) != 1 or len(high) != 1 or int(low[0]) >= int(high[0]):
            return mention
        between = [self._numbers.get(str(n)) for n in range(int(low[0]), int(high[0]) + 1)]
        if None in between:
            return Mention("unknown", mention.first, other.last)
        names = tuple(name for name in between if name)
        return Mention("robot", mention.first, other.last, names)

    def _more(self, mention: Mention) -> Mention:
        """Bare numbers that go on with a list: "R2, R4 and 7"."""
        names, last = list(mention.names), mention.last
        while self._cut.text(last) in LIST:
            here = last
            while self._cut.text(here) in LIST:
                here += 1
            robot = self._numbers.get(self._cut.text(here).lstrip("0"))
            if robot is None or self._cut.counts(here + 1):
                break
            names.append(robot)
            last = here + 1
        return Mention("robot", mention.first, last, tuple(dict.fromkeys(names)))

    def _robot_alone(self, at: int) -> Mention | None:
        for name, robot in self._robots.items():
            end = self._cut.named(name, at, also=False)
            if end is not None:
                return Mention("robot", at, end, (robot,))
        return None

    def _counted(self, at: int) -> Mention | None:
        """ "robots 2 and 5", "robot number three", "Roboter drei und vier"."""
        here = at + 1
        while self._cut.text(here) in {"number", "no", "nr", "nummer", "."}:
            here += 1
        names: list[str] = []
        unknown = False
        last = here
        while (number := whole(self._cut.text(here))) is not None:
            if self._cut.text(here + 1) in {"%", "percent", "prozent", "minutes", "hours"}:
                break
            robot = self._numbers.get(str(number))
            unknown |= robot is None
            names += [robot] if robot else []
            last = here + 1
            here = last
            while self._cut.text(here) in LIST:
                here += 1
        if last == here == at + 1 or not (names or unknown):
            return None
        return Mention("unknown" if unknown else "robot", at, last, () if unknown else tuple(names))

    def _family(self, at: int) -> Mention | None:
        """ "both scouts", "the two dozers", "alle drei Loks": all whose names begin so."""
        words = [self._cut.text(n) for n in range(at, at + _FAMILY)]
        compared = self._cut.text(at - 1) in _COMPARES
        found = family_at(words, self._families, compared=compared)
        if found is None:
            return None
        names, length = found
        return Mention("robot" if names else "unknown", at, at + length, names)
