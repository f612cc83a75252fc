"""Finds the robots that a wish names: one, a list, a range, by numbers, or all of a kind."""

from __future__ import annotations

import re
from collections.abc import Sequence

from llm_gateway.wishes.names.cut import LIST, RANGE, Cut
from llm_gateway.wishes.names.families import families, family_at
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.words import key

_NUMBERED = re.compile(r"\d+")
_COMPARES = {"als", "ausser", "bar", "before", "but", "except", "just", "keine", "keinen", "keiner",
             "no", "nur", "ohne", "only", "than", "vor", "without"}  # fmt: skip
_WHOLE = {"all", "any", "each", "none"}
"""Before "of the scouts" they mean all of them."""
_ALIKE = ("en", "er")
"""So end German words whose plural is the same."""
_OTHERS = {"mehr", "more", "of", "other", "others", "von", "weitere", "weiteren"}
"""Behind a number they say that it is of others: "R2 and two more"."""
_FAMILY = 4
"""Words of "all of the scouts"."""


def _unknown(first: int, last: int) -> Mention:
    return Mention("unknown", first, last)


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
        named = self._robot_alone(at)
        if named is not None and self._cut.noughts(named.last):
            return _unknown(at, named.last + 1)  # "R one oh two".
        if named is not None and not self._goes_on(named.last):
            return self._more(self._range(named))
        if self._cut.text(at) in self._prefixes:
            sign = 1 if self._cut.text(at + 1) in {"-", "_"} else 0
            digits = self._cut.text(at + 1 + sign).lstrip("0")
            if self._cut.text(at + 1 + sign).isdecimal():
                one = self._with_number(digits, self._cut.text(at))
                if one is None:
                    return _unknown(at, at + 2 + sign)
                return self._more(self._range(Mention("robot", at, at + 2 + sign, (one,))))
        return None

    def _with_number(self, digits: str, head: str) -> str | None:
        """The one robot of a number, of those whose names begin so; without a head of all."""
        held = self._numbered.get(digits, [])
        one = [n for n in held if not head or key(n)[0] in (head, head.removesuffix("s"))]
        return one[0] if len(one) == 1 else None

    def _range(self, mention: Mention) -> Mention:
        """R1 to R4, R1-4 or units one to four, where all of them exist."""
        if self._cut.text(mention.last) not in RANGE or not mention.names:
            return mention
        other = self._robot_alone(mention.last + 1) or self._dashed(mention) or self._to(mention)
        if other is None:
            return mention
        if not other.names:
            return _unknown(mention.first, other.last)
        low, high = (_NUMBERED.findall(name) for name in (mention.names[0], other.names[0]))
        if len(low) != 1 or len(high) != 1 or int(low[0]) >= int(high[0]):
            return mention
        if int(high[0]) - int(low[0]) >= len(self._robots):
            return _unknown(mention.first, other.last)  # Some of them have no robot.
        head = key(mention.names[0])[0]
        numbers = range(int(low[0]), int(high[0]) + 1)
        between = [self._with_number(str(n), head) for n in numbers]
        if None in between:
            return _unknown(mention.first, other.last)
        names = tuple(name for name in between if name)
        return Mention("robot", mention.first, other.last, names)

    def _dashed(self, mention: Mention) -> Mention | None:
        """The second number of "R1-4"."""
        at = mention.last + 1
        digits = self._cut.text(at)
        dashed = self._cut.text(mention.last) in {"-", "–"} and self._cut.touches(mention.last)
        if not (dashed and digits.isdecimal()) or self._cut.counts(at + 1):
            return None
        robot = self._with_number(digits.lstrip("0"), key(mention.names[0])[0])
        return None if robot is None else Mention("robot", at, at + 1, (robot,))

    def _to(self, mention: Mention) -> Mention | None:
        """The second number of "units one to four"; unknown where no robot has it."""
        head, at = key(mention.names[0])[0], mention.last + 1
        number = self._cut.number(at) if self._several(mention.first, head) else None
        if number is None or self._cut.counts(number[1]):
            return None
        found = self._bare(at, head)
        return Mention("robot", at, found[1], (found[0],)) if found else _unknown(at, number[1])

    def _more(self, mention: Mention) -> Mention:
        """Bare numbers that go on with a list: "R2, R4 and 7", "units two, four and seven"."""
        if not mention.names:
            return mention
        names, last = list(mention.names), mention.last
        head = key(names[-1])[0]
        several = self._several(mention.first, head)
        while self._cut.text(last) in LIST or several:
            here = last
            while self._cut.text(here) in LIST:
                here += 1
            here += self._cut.text(here) in {"-", "–"}  # "FTF-21 und -22".
            in_words = several or self._cut.noughts(here)
            found = self._bare(here, head) if in_words or self._cut.text(here).isdecimal() else None
            if found is None:
                break
            names.append(found[0])
            last = found[1]
        return Mention("robot", mention.first, last, tuple(dict.fromkeys(names)))

    def _bare(self, at: int, head: str) -> tuple[str, int] | None:
        """The robot whose name begins so and whose bare number stands from word `at` on, and the
        word behind it."""
        found = self._cut.number(at)
        if found is None or self._cut.counts(found[1]) or self._cut.text(found[1]) in _OTHERS:
            return None
        robot = self._with_number(str(found[0]).lstrip("0"), head)
        return None if robot is None else (robot, found[1])

    def _several(self, at: int, head: str) -> bool:
        """Whether word `at` says that several robots whose names begin so are told by number:
        "units", "die Posten"."""
        said = self._cut.text(at)
        alike = head.endswith(_ALIKE) and self._cut.text(at - 1) == "die"
        return alike if said == head else len(head) > 1 and said.startswith(head)

    def _robot_alone(self, at: int) -> Mention | None:
        """The robot whose name is written from word `at` on; unknown where it may be another's."""
        ends = {
            robot: end
            for name, robot in self._robots.items()
            if (end := self._cut.named(name, at, also=False)) is not None
        }
        if not ends:
            return None
        last = max(ends.values())
        best = [robot for robot, end in ends.items() if end == last]
        written = key(" ".join(self._cut.text(n) for n in range(at, last)))
        exact = [robot for robot in best if key(robot) == written]
        best = exact or best
        return Mention("robot", at, last, (best[0],)) if len(best) == 1 else _unknown(at, last)

    def _goes_on(self, at: int) -> bool:
        """Whether the number at word `at` makes another name of the one before it: "R1 2"."""
        return self._cut.text(at).isdecimal() and not self._cut.opens_point(at)

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
