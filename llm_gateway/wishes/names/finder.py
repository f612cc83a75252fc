"""Finds the one thing that a wish names from a word on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from datetime import datetime

from llm_gateway.wishes.cues.plain import known
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.cut import LIST, Cut, other_words
from llm_gateway.wishes.names.forms import are_heads, called, is_head, same
from llm_gateway.wishes.names.mention import Kind, Mention
from llm_gateway.wishes.names.people import CALLED, ENDS, SPEAKS, TITLES
from llm_gateway.wishes.names.policies import Policies
from llm_gateway.wishes.names.roster import Roster
from llm_gateway.wishes.numbers import tens_behind, whole
from llm_gateway.wishes.shares import is_torn, share_at
from llm_gateway.wishes.times.phrases import when_at
from llm_gateway.wishes.times.when import When
from llm_gateway.wishes.tongue import is_german_noun
from llm_gateway.wishes.words import Word, alike, key
from swarm.messages.intent import Site

LEADS = frozenset(
    """a also am an and around at auch auf bei beim by dem den der die das for fuer hinter im
    in into near of on or our that the this to um und unser unsere vor watch weil zum
    zur""".split()
)
"""Before a place's main word they say that no other place is meant."""
_GREETINGS = {"hello", "hi", "hey", "dear", "hallo", "liebe", "liebes", "geehrte", "geehrter",
              "geehrten", "moin", "servus", "thanks",
              "danke"}  # fmt: skip
"""Whom they greet is nobody whom the detector finds."""


_EXCEPT = {"ausgenommen", "ausser", "barring", "except", "excepting"}
_ALL = {"all", "alle", "allen", "aller"}
_BOTH = {"both", "beide", "beiden", "beider"}
_OF_THEM = {"the", "of", "our", "der", "die", "den", "unsere", "unserer"}
_LEAST = 2
"""Places that share a main word are several; words that end a place's name name it."""
_LEAST_JOINED = 3
"""Letters of the second word of two that are one."""
_CLAUSE = 6
"""Words behind "rechnet" that say how."""
_TURNS = {"", ",", "aber", "and", "but", "just", "nur", "only", "und"}
"""Before "not" and a time."""


def _endings(
    places: Mapping[tuple[str, ...], str], taken: Set[tuple[str, ...]]
) -> dict[tuple[str, ...], str]:
    """Places by the last words of their names, where one place alone ends so and nothing is called
    so: "rest area" of "labour rest area"."""
    found: dict[tuple[str, ...], set[str]] = {}
    for name, place in places.items():
        for first in range(1, len(name) - _LEAST + 1):
            if all(word.isalpha() for word in name[first:]) and name[first] not in LEADS:
                found.setdefault(name[first:], set()).add(place)
    return {end: min(held) for end, held in found.items() if len(held) == 1 and end not in taken}


class Finder:
    """Looks at one wish on one site."""

    def __init__(self, wish: str, cut: Sequence[Word], site: Site) -> None:
        self._wish = wish
        self._words = cut
        self._cut = Cut(cut)
        self._text = self._cut.text
        self._named = self._cut.named
        self._roster = Roster(self._cut, site.robots)
        self._places = {
            key(said): name for name in site.places for said in site.words.get(name, ())
        } | {key(name): name for name in site.places}
        self._named_places = site.places
        self._heads = {k[0] for k in self._places if len(k) == 2 and k[1].isdigit()}
        self._classes = {key(name): name for name in site.classes}
        self._endings = _endings(self._places, {*self._places, *self._classes})
        self._policies = Policies(cut)
        self._seen: list[str] = []
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
        if found is not None and found.kind == "place":
            self._seen += [name for name in found.names if name not in self._seen]
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
            self._place(at)
            or self._both(at)
            or self._roster.at(at)
            or self._when(at, now)
            or self._share(at)
            or self._class(at)
            or self._plain(at)
            or self._again(at)
            or self._stranger(at)
        )

    def _place(self, at: int) -> Mention | None:
        hits: dict[str, int] = {}
        for name, place in (*self._places.items(), *self._endings.items()):
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

    def _both(self, at: int) -> Mention | None:
        """ "both docks", "alle Tore": all places of that main word; of more than two both that were
        named before."""
        if self._text(at) not in _ALL | _BOTH:
            return None
        head = at + 1
        while self._text(head) in _OF_THEM:
            head += 1
        if self._place(head) or self._roster.at(head) or self._class(head):
            return None
        if self._cut.number(head + 1) is not None:
            return None
        said = self._text(head)
        if any(same(said, place) for place in lexicon.PLACES):
            return None  # "All areas" are more than those that are called so.
        held = tuple(name for name in self._named_places if are_heads(said, key(name)))
        if self._text(at) in _BOTH and len(held) > _LEAST:
            held = tuple(name for name in held if name in self._seen)
        several = len(held) == _LEAST if self._text(at) in _BOTH else len(held) >= _LEAST
        return Mention("place", at, head + 1, held) if several else None

    def _again(self, at: int) -> Mention | None:
        """The place that was named before, by its main word: "the hall", "the area"."""
        text = self._text(at)
        pointed = self._text(at - 1) in {"the", "that", "this", "den", "dem", "der", "die", "das"}
        pointed &= self._text(at + 1) not in {"of", "to", "where", "wo"}
        if text in lexicon.PLACES and pointed and len(self._seen) == 1:
            return Mention("place", at, at + 1, (self._seen[0],))
        held = [name for name in self._seen if is_head(text, key(name))]
        rest, before = self._text(at + 1), self._text(at - 1)
        other = before.isalpha() and before not in LEADS
        if other or len(held) != 1 or rest.isdigit() or whole(rest) is not None:
            return None
        return Mention("place", at, at + 1, (held[0],))

    def _more_places(self, mention: Mention) -> Mention:
        """Bare numbers that go on with a list: "aisles 1 and 2"."""
        head, *number = key(mention.names[0])
        names, last = list(mention.names), mention.last
        while len(number) == 1 and number[0].isdigit() and self._text(last) in LIST:
            place = self._places.get((head, self._text(last + 1)))
            if place is None or self._cut.counts(last + 2):
                break
            names.append(place)
            last += 2
        return Mention("place", mention.first, last, tuple(dict.fromkeys(names)))

    def _spelt(self, place: str, at: int, end: int) -> bool:
        """Whether a place's name, or a word that the site has for it, is written so."""
        said = tuple(word.text for word in self._words[at:end] if word.text not in "-_./")
        return place in (self._places.get(said), self._endings.get(said))

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

    def _class(self, at: int) -> Mention | None:
        hits = {}
        if self._text(at - 1) in _GREETINGS or self._calls(at):
            return None
        for name, label in self._classes.items():
            end = self._named(name, at, also=False)
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
        if text in lexicon.SENDING and near & lexicon.LITTLE:
            return Mention("network", at, at + 1)
        if text in lexicon.ENERGY and near & lexicon.SAVING:
            return Mention("compute", at, at + 1)
        return self._policies.at(at)

    def _computing(self, at: int) -> int | None:
        """The word behind what computes, or the computing."""
        text = self._text(at)
        last = at + 1 + (self._text(at + 1) == "-")
        if text == "edge" and self._text(last) in lexicon.EDGE and self._class(last) is None:
            return last + 1
        room = text in {"server", "servers"} and self._text(last) in lexicon.ROOMS
        known_so = {text, text.removesuffix("s")} & lexicon.COMPUTE and not room
        behind = {self._text(n) for n in range(at + 1, at + _CLAUSE)}
        sparingly = (behind | {self._text(at - 1)}) & lexicon.SPARINGLY and "mit" not in behind
        if known_so or lexicon.COMPUTERS.fullmatch(text):
            return at + 1
        return at + 1 if text in lexicon.CALCULATING and sparingly else None

    def _stranger(self, at: int) -> Mention | None:
        """A name as the site's, of something that it does not have: R9, aisle 9."""
        text, following = self._text(at), self._text(at + 1)
        heads = {word for head in self._heads for word in other_words(head) | {head}}
        if text in heads and (following.isdigit() or whole(following) is not None):
            return Mention("unknown", at, at + 2)
        if text == "r" and following.isdigit():
            return Mention("unknown", at, at + 2)
        return None
