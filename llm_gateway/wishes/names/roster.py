"""Finds the robots that a wish names: one, a list, a range, by numbers, or all of a kind."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.cut import LIST, Cut
from llm_gateway.wishes.names.families import families, family_at
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.words import key

_RANGE = {"to", "through", "thru", "bis", "-", "–", ".."}
_NUMBERED = re.compile(r"\d+")
_COMPARES = {"als", "ausser", "bar", "before", "but", "except", "just", "keine", "keinen", "keiner",
             "no", "nur", "ohne", "only", "than", "vor", "without"}  # fmt: skip
_WHOLE = {"all", "any", "each", "none"}
"""Before "of the scouts" they mean all of them."""
_FAMILY = 4
"""Words of "all of the scouts"."""


class Roster:
    """The robots of a site, as they are looked for in one wish."""

    def __init__(self, cut: Cut, robots: Sequence[str]) -> None:
        self._cut = cut
        self._families = families(robots)
        self._robots = {key(name): name for name in robots}
        self._numbered: dict[str, list[str]] = {}
        for name in robots:
            digits = _NUMBERED.findall(name)
            if len(digits) == 1:
                self._numbered.setdefault(digits[0].lstrip("0"), []).append(name)
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
                one = self._with_number(digits, self._cut.text(at))
                if one is None:
                    return Mention("unknown", at, at + 2 + sign)
                return self._more(self._range(Mention("robot", at, at + 2 + sign, (one,))))
        if self._cut.text(at) in lexicon.ROBOT_WORDS:
            return self._counted(at)
        return None

    def _with_number(self, digits: str, head: str) -> str | None:
        """The one robot of a number, of those whose names begin so where several have it."""
        held = self._numbered.get(digits, [])
        alike = [name for name in held if key(name)[0] in (head, head.removesuffix("s"))]
        one = held if len(held) == 1 else alike
        return one[0] if len(one) == 1 else None

    def _range(self, mention: Mention) -> Mention:
        """R1 to R4, or R1-4, where all of them exist."""
        if self._cut.text(mention.last) not in _RANGE:
            return mention
        other = self._robot_alone(mention.last + 1) or self._dashed(mention)
        if other is None:
            return mention
        low, high = (_NUMBERED.findall(name) for name in (mention.names[0], other.names[0]))
        if len(low) != 1 or len(high) != 1 or int(low[0]) >= int(high[0]):
            return mention
        head = key(mention.names[0])[0]
        numbers = range(int(low[0]), int(high[0]) + 1)
        between = [self._with_number(str(n), head) for n in numbers]
        if None in between:
            return Mention("unknown", mention.first, other.last)
        names = tuple(name for name in between if name)
        return Mention("robot", mention.first, other.last, names)

    def _dashed(self, mention: Mention) -> Mention | None:
        """The second number of "R1-4"."""
        at = mention.last + 1
        digits = self._cut.text(at)
        dashed = self._cut.text(mention.last) in {"-", "–"} and self._cut.touches(mention.last)
        if not (dashed and digits.isdigit()) or self._cut.counts(at + 1):
            return None
        robot = self._with_number(digits.lstrip("0"), key(mention.names[0])[0])
        return None if robot is None else Mention("robot", at, at + 1, (robot,))

    def _more(self, mention: Mention) -> Mention:
        """Bare numbers that go on with a list: "R2, R4 and 7"."""
        names, last = list(mention.names), mention.last
        while self._cut.text(last) in LIST:
            here = last
            while self._cut.text(here) in LIST:
                here += 1
            here += self._cut.text(here) in {"-", "–"}  # "FTF-21 und -22".
            robot = self._with_number(self._cut.text(here).lstrip("0"), key(names[-1])[0])
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
        while (found := self._cut.number(here)) is not None:
            number, behind = found
            if self._cut.text(behind) in {"%", "percent", "prozent", "minutes", "hours"}:
                break
            robot = self._with_number(str(number), "")
            unknown |= robot is None
            names += [robot] if robot else []
            last = here = behind
            while self._cut.text(here) in LIST:
                here += 1
        if last == here == at + 1 or not (names or unknown):
            return None
        return Mention("unknown" if unknown else "robot", at, last, () if unknown else tuple(names))

    def _family(self, at: int) -> Mention | None:
        """ "both scouts", "the two dozers", "alle drei Loks": all whose names begin so."""
        words = [self._cut.text(n) for n in range(at, at + _FAMILY)]
        before = self._cut.text(at - 1)
        whole = before == "of" and self._cut.text(at - 2) in _WHOLE
        compared = whole or before in _COMPARES
        found = family_at(words, self._families, compared=compared)
        if found is None:
            return None
        names, length = found
        return Mention("robot" if names else "unknown", at, at + length, names)
