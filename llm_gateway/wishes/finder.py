"""Finds the one thing that a wish names from a word on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime

from llm_gateway.wishes import lexicon
from llm_gateway.wishes.mention import Kind, Mention
from llm_gateway.wishes.numbers import NAMED, share_at, whole
from llm_gateway.wishes.times import when_at
from llm_gateway.wishes.words import Word, alike, key
from swarm.messages.intent import Site

LIST = {
    ",",
    "and",
    "or",
    "und",
    "oder",
    "&",
    "/",
    "+",
    "sowie",
    "plus",
    "nor",
    "noch",
    "as",
    "well",
    "adn",
    "nad",
    "n",
    "udn",
}
_RANGE = {"to", "through", "thru", "bis", "-", "–", ".."}
_PLURALS = ("s", "es", "n", "en", "e", "er", "ern", "r")
_NO_NAMES = frozenset(
    """% percent prozent per minutes minute hours hour min h uhr am pm oclock minuten
    stunden""".split()  # noqa: SIM905
)
"""Behind a number they say that it is no robot's."""
_GREETINGS = {"hello", "hi", "hey", "dear", "hallo", "liebe", "liebes", "geehrte", "geehrter",
              "geehrten", "moin", "servus", "thanks",
              "danke"}  # fmt: skip
"""Whom they greet is nobody whom the detector finds."""
_INFLECTED = {"achte", "neune", "sechse", "siebene", "fuenfe"}
"""Rather a verb or an hour than a name's number."""
_NUMBERED = re.compile(r"\d+")


class Finder:
    """Looks at one wish on one site."""

    def __init__(self, cut: Sequence[Word], site: Site) -> None:
        self._words = cut
        self._robots = {key(name): name for name in site.robots}
        self._numbers = {
            digits[0].lstrip("0"): name
            for name in site.robots
            if len(digits := _NUMBERED.findall(name)) == 1
        }
        heads = {k[0] for k in self._robots if len(k) == 2 and k[0].isalpha()}
        self._prefixes = heads | {head + "s" for head in heads if len(head) > 1}
        self._places = {
            key(said): name for name in site.places for said in site.words.get(name, ())
        } | {key(name): name for name in site.places}
        self._heads = {k[0] for k in self._places if len(k) == 2 and k[1].isdigit()}
        self._classes = {key(name): name for name in site.classes}
        self._policies: set[str] = set()

    def at(self, at: int, now: datetime) -> Mention | None:
        """What is named from word `at` on."""
        return (
            self._place(at)
            or self._robot(at)
            or self._when(at, now)
            or self._share(at)
            or self._class(at)
            or self._plain(at)
            or self._stranger(at)
        )

    def _text(self, at: int) -> str:
        return self._words[at].text if 0 <= at < len(self._words) else ""

    def _named(self, name: Sequence[str], at: int, *, also: bool) -> int | None:
        """The word behind a name that is written from word `at` on; `also` in other words."""
        here = at
        for part in name:
            if here > at and self._text(here) in {"-", "_"}:
                here += 1
            said = self._text(here)
            if not said or not (_same(said, part) or (also and said in _others(part))):
                return None
            here += 1
        return here

    def _place(self, at: int) -> Mention | None:
        hits: dict[str, int] = {}
        for name, place in self._places.items():
            end = self._named(name, at, also=True)
            if end is not None:
                hits[place] = max(end, hits.get(place, end))
        if not hits:
            return None
        end = max(hits.values())
        best = [place for place, last in hits.items() if last == end]
        exact = [place for place in best if self._spelt(place, at, end)]
        best = exact if len(exact) == 1 else best
        classes = self._class(at)
        if not exact and classes is not None:
            return Mention("unknown", at, end)
        if len(best) > 1:
            return Mention("unknown", at, end)
        return self._more_places(Mention("place", at, end, (best[0],)))

    def _more_places(self, mention: Mention) -> Mention:
        """Bare numbers that go on with a list: "aisles 1 and 2"."""
        head, *number = key(mention.names[0])
        names, last = list(mention.names), mention.last
        while len(number) == 1 and number[0].isdigit() and self._text(last) in LIST:
            place = self._places.get((head, self._text(last + 1)))
            if place is None or self._text(last + 2) in _NO_NAMES:
                break
            names.append(place)
            last += 2
        return Mention("place", mention.first, last, tuple(dict.fromkeys(names)))

    def _spelt(self, place: str, at: int, end: int) -> bool:
        """Whether a place's name, or a word that the site has for it, is written so."""
        said = tuple(word.text for word in self._words[at:end] if word.text not in "-_")
        return self._places.get(said) == place

    def _robot(self, at: int) -> Mention | None:
        for name, robot in sorted(self._robots.items(), key=lambda item: -len(item[0])):
            end = self._named(name, at, also=False)
            if end is not None and not self._text(end).isdigit():
                return self._more(self._range(Mention("robot", at, end, (robot,))))
        if self._text(at) in self._prefixes:
            sign = 1 if self._text(at + 1) in {"-", "_"} else 0
            digits = self._text(at + 1 + sign).lstrip("0")
            if self._text(at + 1 + sign).isdigit():
                robot = self._numbers.get(digits, "")
                names = (robot,) if robot else ()
                found = Mention("robot" if robot else "unknown", at, at + 2 + sign, names)
                return self._more(found) if robot else found
        if self._text(at) in lexicon.ROBOT_WORDS:
            return self._counted(at)
        return None

    def _range(self, mention: Mention) -> Mention:
        """R1 to R4, where all of them exist."""
        if self._text(mention.last) not in _RANGE:
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
        while self._text(last) in LIST:
            here = last
            while self._text(here) in LIST:
                here += 1
            robot = self._numbers.get(self._text(here).lstrip("0"))
            if robot is None or self._text(here + 1) in _NO_NAMES:
                break
            names.append(robot)
            last = here + 1
        return Mention("robot", mention.first, last, tuple(dict.fromkeys(names)))

    def _robot_alone(self, at: int) -> Mention | None:
        for name, robot in self._robots.items():
            end = self._named(name, at, also=False)
            if end is not None:
                return Mention("robot", at, end, (robot,))
        return None

    def _counted(self, at: int) -> Mention | None:
        """ "robots 2 and 5", "robot number three", "Roboter drei und vier"."""
        here = at + 1
        while self._text(here) in {"number", "no", "nr", "nummer", "."}:
            here += 1
        names: list[str] = []
        unknown = False
        last = here
        while (number := whole(self._text(here))) is not None:
            if self._text(here + 1) in {"%", "percent", "prozent", "minutes", "hours"}:
                break
            robot = self._numbers.get(str(number))
            unknown |= robot is None
            names += [robot] if robot else []
            last = here + 1
            here = last
            while self._text(here) in LIST:
                here += 1
        if last == here == at + 1 or not (names or unknown):
            return None
        return Mention("unknown" if unknown else "robot", at, last, () if unknown else tuple(names))

    def _when(self, at: int, now: datetime) -> Mention | None:
        when = when_at(self._words, at, now)
        return None if when is None else Mention("time", at, when.last, when=when)

    def _share(self, at: int) -> Mention | None:
        share = share_at(self._words, at)
        return None if share is None else Mention("share", at, share.last, share=share)

    def _class(self, at: int) -> Mention | None:
        hits = {}
        if self._text(at - 1) in _GREETINGS:
            return None
        for name, label in self._classes.items():
            end = self._named(name, at, also=False)
            others = lexicon.CLASSES.get(" ".join(name), "").split()
            if end is None and {self._text(at), self._text(at).removesuffix("n")} & {*others}:
                end = at + 1
            if end is not None:
                hits[label] = end
        if not hits:
            return None
        end = max(hits.values())
        best = [label for label, last in hits.items() if last == end]
        if len(best) > 1:
            best = [b for b in best if b == self._text(at)] or best
        kind: Kind = "class" if len(best) == 1 else "unknown"
        return Mention(kind, at, end, tuple(best) if kind == "class" else ())

    def _plain(self, at: int) -> Mention | None:
        text = self._text(at)
        if text == "net" and self._text(at - 1) not in {"the", "our", "this", "that", "your", "on"}:
            return None  # "Nicht" in the south.
        if text in lexicon.NETWORK or alike(text, "bandwidth") or alike(text, "bandbreite"):
            return Mention("network", at, at + 1)
        if text in lexicon.COMPUTE:
            return Mention("compute", at, at + 1)
        return self._policy(at)

    def _policy(self, at: int) -> Mention | None:
        near = {self._text(n) for n in range(at - 5, at + 6)}
        taken = {self._text(n) for n in range(at - 3, at + 4)} & lexicon.TAKE
        known = (*lexicon.PLAIN_POLICIES.items(), *lexicon.POLICIES.items())
        hits = {
            end: (policy, name)
            for policy, names in known
            for name in names
            if (end := self._named(name.split(), at, also=False)) is not None
        }
        if not hits or self._text(max(hits)) in {"of", "at", "in", "on", "near"}:
            # "better coverage of the docks" names no policy.
            return None
        policy, name = hits[max(hits)]
        plain = name in lexicon.PLAIN_POLICIES.get(policy, ())
        if plain or taken or near & lexicon.POLICY_WORDS or policy in self._policies:
            self._policies.add(policy)
            return Mention("policy", at, max(hits), (policy,))
        # "Coverage" is a plain word, too; what is meant by the others has to be asked.
        return None if policy == "coverage" else Mention("unknown", at, max(hits))

    def _stranger(self, at: int) -> Mention | None:
        """A name as the site's, of something that it does not have: R9, aisle 9."""
        text, following = self._text(at), self._text(at + 1)
        heads = {word for head in self._heads for word in _others(head) | {head}}
        if text in heads and (following.isdigit() or whole(following) is not None):
            return Mention("unknown", at, at + 2)
        if text == "r" and following.isdigit():
            return Mention("unknown", at, at + 2)
        return None


def _same(said: str, meant: str) -> bool:
    """Whether a word is another one, in another form of it, or with a slip."""
    if said == meant or alike(said, meant):
        return True
    if meant.isdigit() and said in NAMED and said not in _INFLECTED:
        return NAMED[said] == int(meant[:9])
    if not (said.isalpha() and meant.isalpha()) or min(len(said), len(meant)) < 3:
        return False
    longer, shorter = (said, meant) if len(said) > len(meant) else (meant, said)
    return longer in {shorter + ending for ending in _PLURALS} or (
        shorter.endswith("y") and longer == shorter[:-1] + "ies"
    )


def _others(part: str) -> set[str]:
    return set(lexicon.HEADS.get(part, "").split())
