"""Finds the places that a wish names: by their names, what people call them, or as lists."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set

from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.classes import Classes
from llm_gateway.wishes.names.cut import LEADS, LIST, RANGE, Cut, other_words, plurals
from llm_gateway.wishes.names.forms import are_heads, is_head, same
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.roster import Roster
from llm_gateway.wishes.numbers import whole
from llm_gateway.wishes.words import Word, key
from swarm.messages.intent import Site

_ALL = {"all", "alle", "allen", "aller"}
_BOTH = {"both", "beide", "beiden", "beider"}
_OF_THEM = {"the", "of", "our", "der", "die", "den", "unsere", "unserer"}
_LEAST = 2
"""Places that share a main word are several; words that end a place's name name it."""
_LEAST_ENDING = 4
"""Letters of a word that may end another one."""
_SAYS = {"are", "sind"}
"""Behind "aisle two and three" they say that the second number is an aisle's, too."""

Name = tuple[str, ...]


def _endings(places: Mapping[Name, str], taken: Set[Name]) -> dict[Name, str]:
    """Places by the last words of their names, where one place alone ends so and nothing is called
    so: "rest area" of "labour rest area"."""
    found: dict[Name, set[str]] = {}
    for name, place in places.items():
        for first in range(1, len(name) - _LEAST + 1):
            if all(word.isalpha() for word in name[first:]) and name[first] not in LEADS:
                found.setdefault(name[first:], set()).add(place)
    return {end: min(held) for end, held in found.items() if len(held) == 1 and end not in taken}


def _called(places: Mapping[Name, str], taken: Set[Name]) -> dict[Name, str]:
    """Places by what people call them as a whole: "Laderampe" of "docks", "Quergang 1" of "cross
    aisle 1", and "Quergang" where no second one is numbered."""
    found: dict[Name, set[str]] = {}
    for name, place in places.items():
        head, number = (name[:-1], name[-1:]) if name[-1].isdecimal() else (name, ())
        ways = [key(way) for way in lexicon.WHOLES.get(" ".join(head), ())]
        ways = [way for way in ways if not _another(way[-1], head, places)]
        alone = [head, *ways] if number and len(head) >= _LEAST else []
        for way in (*((*way, *number) for way in ways), *alone):
            found.setdefault(way, set()).add(place)
    return {way: min(held) for way, held in found.items() if len(held) == 1 and way not in taken}


def _another(word: str, head: Name, places: Mapping[Name, str]) -> bool:
    """Whether what people call a place may as well be another one: "Laderampe" beside a ramp."""
    others = {other for name in places for other in name if other not in head and other.isalpha()}
    ways = {way for other in others for way in other_words(other) | {other}}
    return any(len(way) >= _LEAST_ENDING and word.endswith(way) for way in ways)


class Places:
    """Looks for places in one wish."""

    def __init__(self, words: Sequence[Word], site: Site, roster: Roster, classes: Classes) -> None:
        self._words = words
        self._cut = Cut(words)
        self._text = self._cut.text
        self._roster = roster
        self._classes = classes
        self._places = {
            key(said): name for name in site.places for said in site.words.get(name, ())
        } | {key(name): name for name in site.places}
        self._places.pop((), None)  # A name of signs alone is written nowhere.
        self._named_places = site.places
        self._heads = {k[0] for k in self._places if len(k) == 2 and k[1].isdecimal()}
        taken = {*self._places, *(key(name) for name in site.classes)}
        self._endings = _endings(self._places, taken)
        self._called = _called(self._places, taken)
        self.seen: list[str] = []
        """Those that were named, in order."""

    def at(self, at: int) -> Mention | None:
        """The places that are named from word `at` on; unknown where they may be others."""
        return self._place(at) or self._both(at)

    def see(self, names: Sequence[str]) -> None:
        """Tells which ones were named."""
        self.seen += [name for name in names if name not in self.seen]

    def _place(self, at: int) -> Mention | None:
        hits: dict[str, int] = {}
        for name, place in self._ways(at):
            end = self._cut.named(name, at, also=True)
            if end is not None:
                hits[place] = max(end, hits.get(place, end))
        if not hits:
            return None
        end = max(hits.values())
        best = [place for place, last in hits.items() if last == end]
        exact = [place for place in best if self._spelt(place, at, end)]
        best = exact if len(exact) == 1 else best
        classes = self._classes.at(at)
        if not exact and classes is not None:
            return Mention("unknown", at, end)
        if len(best) > 1:
            return Mention("unknown", at, end)
        if not exact and self._numbered(at, end):
            return Mention("unknown", at, end + 1)  # "Cross aisle 7".
        return self._more_places(Mention("place", at, end, (best[0],)))

    def _ways(self, at: int) -> Iterator[tuple[Name, str]]:
        """What the place from word `at` on may be called, and the place."""
        yield from self._places.items()
        yield from self._endings.items()
        said = self._text(at)
        for way, place in self._called.items():
            if said == way[0] or said not in lexicon.HEADS:
                yield way, place  # But a ramp is no Rampe, where the docks are.

    def _numbered(self, at: int, end: int) -> bool:
        """Whether a number goes on with what people call a place, which then is another one."""
        said = tuple(word.text for word in self._words[at:end] if word.text not in "-_./")
        found = self._cut.number(end) if said in self._called else None
        counts = found is None or self._cut.counts(found[1]) or self._cut.opens_point(end)
        return not (counts or said[-1].isdecimal())

    def _both(self, at: int) -> Mention | None:
        """ "both docks", "alle Tore": all places of that main word; of more than two both that were
        named before."""
        if self._text(at) not in _ALL | _BOTH:
            return None
        head = at + 1
        while self._text(head) in _OF_THEM:
            head += 1
        if self._place(head) or self._roster.at(head) or self._classes.at(head):
            return None
        if self._cut.number(head + 1) is not None:
            return None
        said = self._text(head)
        if any(same(said, place) for place in lexicon.PLACES):
            return None  # "All areas" are more than those that are called so.
        held = tuple(name for name in self._named_places if are_heads(said, key(name)))
        if self._text(at) in _BOTH and len(held) > _LEAST:
            held = tuple(name for name in held if name in self.seen)
        several = len(held) == _LEAST if self._text(at) in _BOTH else len(held) >= _LEAST
        return Mention("place", at, head + 1, held) if several else None

    def again(self, at: int) -> Mention | None:
        """The place that was named before, by its main word: "the hall", "the area"."""
        text = self._text(at)
        pointed = self._text(at - 1) in {"the", "that", "this", "den", "dem", "der", "die", "das"}
        pointed &= self._text(at + 1) not in {"of", "to", "where", "wo"}
        if text in lexicon.PLACES and pointed and len(self.seen) == 1:
            return Mention("place", at, at + 1, (self.seen[0],))
        held = [name for name in self.seen if is_head(text, key(name))]
        rest, before = self._text(at + 1), self._text(at - 1)
        other = before.isalpha() and before not in LEADS
        if other or len(held) != 1 or rest.isdecimal() or whole(rest) is not None:
            return None
        return Mention("place", at, at + 1, (held[0],))

    def _more_places(self, mention: Mention) -> Mention:
        """Bare numbers that go on with a list: "aisles 1 and 2", "aisles one to three"."""
        head, *number = key(mention.names[0])
        if len(number) != 1 or not number[0].isdecimal():
            return mention
        several = self._text(mention.first) in plurals(head)
        if several and self._text(mention.last) in RANGE:
            return self._to(mention, head, int(number[0][:9]))
        names, last = list(mention.names), mention.last
        while self._text(last) in LIST:
            here = last + 1
            here += self._text(last) == "," and self._text(here) in LIST
            found = self._cut.number(here)
            place = None if found is None else self._places.get((head, str(found[0])))
            if found is None or place is None or self._cut.counts(found[1]):
                break
            if self._text(here).isalpha() and not self._tells(found[1], several=several):
                break
            names.append(place)
            last = found[1]
        return Mention("place", mention.first, last, tuple(dict.fromkeys(names)))

    def _tells(self, behind: int, *, several: bool) -> bool:
        """Whether a number in words is a place's, and counts nothing: "aisle two and three are"."""
        counted = self._classes.at(behind) or self._text(behind) in lexicon.ROBOT_WORDS
        return not counted if several else self._text(behind) in _SAYS

    def _to(self, mention: Mention, head: str, low: int) -> Mention:
        """ "aisles one to three"; unknown where there are not so many."""
        found = self._cut.number(mention.last + 1)
        if found is None or self._cut.counts(found[1]) or found[0] <= low:
            return mention
        high = found[0] if (head, str(found[0])) in self._places else low
        held = [self._places.get((head, str(number))) for number in range(low, high + 1)]
        if high == low or None in held:
            return Mention("unknown", mention.first, found[1])
        return Mention("place", mention.first, found[1], tuple(name for name in held if name))

    def _spelt(self, place: str, at: int, end: int) -> bool:
        """Whether a place's name, or a word that the site has for it, is written so."""
        said = tuple(word.text for word in self._words[at:end] if word.text not in "-_./")
        return place in (self._places.get(said), self._endings.get(said))

    def stranger(self, at: int) -> Mention | None:
        """A name as the site's, of something that it does not have: R9, aisle 9."""
        text, following = self._text(at), self._text(at + 1)
        heads = {word for head in self._heads for word in other_words(head) | {head}}
        if text in heads and (following.isdecimal() or whole(following) is not None):
            return Mention("unknown", at, at + 2)
        if text == "r" and following.isdecimal():
            return Mention("unknown", at, at + 2)
        return None
