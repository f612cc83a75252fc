"""Accounts for what a wish says: what has no role, and must have one, is asked back."""

from __future__ import annotations

import re
from dataclasses import replace

from llm_gateway.wishes.clauses.compared import is_compared
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.numbers import NAMED
from llm_gateway.wishes.reading import Reading
from llm_gateway.wishes.times.phrases import LEFT

_UP_TO = {"before", "till", "until", "by", "til"}
"""Before "then" they say nothing that the time itself does not."""
_UNTIL = {"bis", "til", "till", "until"}
_LONG = {"days", "minutes", "month", "months", "tage", "minuten", "monat", "week", "weeks", "woche",
         "wochen"}  # fmt: skip
_NUMBER = re.compile(r"[\d.,:]*\d[\d.,:]*")
_LAST = {"last", "past", "letzte", "letzter", "letzten"}
_WHOLE = {"all", "ganze", "whole"}
_TOLD = {"been", "had", "hatte", "hatten", "war", "waren", "was", "were"}
_FAR = 12
"""Words before a time among which a report begins."""
_NEAR = 6
"""Words around "bis" that tell what it is of."""
_FALLS = {"absinken", "fallen", "nachgeben", "runter", "runtergehen", "sinken"}
_EXTENDS = re.compile(r"reich(?:t|en)\b|schlange|stau|steh(?:t|en)\b|zieh(?:t|en)\b")
_LIMITS = {"earlier", "earliest", "frueher", "fruehestens", "later", "latest", "sooner", "spaeter",
           "spaetestens"}  # fmt: skip
_THAN_NUMBERS = {"als", "at", "than", "um", *NAMED}
"""Behind "no earlier" they begin a time."""
_BEGUN = {"are", "begin", "began", "have", "is", "started"}
"""Behind "visiting hours" they tell that it is their time."""
_BUSY = {"business", "busy", "office", "opening", "peak", "rush", "visiting"}
_OF_HOURS = {"few", "half", "more", "next", "of", "some", "the", "these", "those", "what"}
_POINTS = {"dann", "then"}
_IS = {"ist", "haben", "hat", "macht", "machen", "schon", "is"}
_AS_YOU_LIKE = {"as", "back", "compare", "like", "normal", "sehen", "want", "whatever", "wie",
                "wollt", "zurueck"}  # fmt: skip
"""Behind "then" they say that nothing more is wished."""
_THEN = {"afterwards", "anschliessend", "danach", "dann", "then"}
_AFTER = {"after", "before", "during", "nach", "vor", "waehrend"}
_EVENTS = frozenset(
    """audit besprechung break delivery dinner fruehstueck lieferung meeting mittagspause
    pause schichtende schichtwechsel shift""".split()
)
"""What begins or ends when only people know."""
_PAPERS = frozenset(
    """auftrag batch bulletin case charge chapter day drill exercise experiment fall formula
    incident item job log memo meldung no notice nr nummer number order page phase project
    reviewer round run runde scenario schicht seite shift step schritt test ticket trial uebung
    version versuch week alarm baujahr chg code error fault fehler fehlercode firmware flight flug
    fw inc ref release req rev software stoerung vorgang""".split()
)
"""Before a number they make a name of it: "notice 14"."""


def settle(text: Text, reading: Reading) -> Reading:
    """A reading in which whatever must be accounted for and is not is unclear."""
    unclear = [*reading.unclear, *_unread(text, reading)]
    for number, (mention, role) in enumerate(zip(text.mentions, reading.roles, strict=True)):
        if role == "none" and number in reading.reasons:
            continue
        told = role == "none" and mention.kind in ("robot", "place", "class", "share", "unknown")
        if told and mention.kind == "share" and _is_told(text, mention):
            continue
        if told and mention.kind == "class" and _has_part(text, mention, reading):
            continue
        if told and "first" in reading.roles and is_compared(text, mention):
            continue
        if role == "doubt" or told:
            unclear.append(question(text, mention))
    return replace(reading, unclear=tuple(dict.fromkeys(unclear)))


def question(text: Text, mention: Mention) -> str:
    """The words in doubt, and what to ask about them where code knows."""
    said = text.said(mention.first, mention.last)
    asked = "" if mention.when is None else mention.when.question
    return f"{said} {asked}".strip()


def unread_ends(text: Text, reading: Reading) -> list[str]:
    """Words that tell until when, or for how long, where no such time was read at all."""
    if any(m.when is not None and (m.when.until or m.when.lasts) for m in text.mentions):
        return []
    inside = {at for m in text.mentions for at in range(m.first, m.last)}
    found = []
    for at, word in enumerate(text.words):
        long = word.text in _LONG and text.words[max(at - 2, 0)].text in {"for", "fuer"}
        until = word.text in _UNTIL and not (word.text == "bis" and _reaches(text, reading, at))
        if at not in inside and (long or until or _waits(text, at)) and not _is_talk(text, at):
            found.append(text.said(at, min(at + 4, len(text.words))))
    return found


def _unread(text: Text, reading: Reading) -> list[str]:
    """Words of times and numbers that belong to nothing that was found; and what is to come only
    after something else."""
    inside = {at for m in text.mentions for at in range(m.first, m.last)} | reading.measured
    timed = any(m.when is not None and (m.when.until or m.when.lasts) for m in text.mentions)
    ranged = any(m.when is not None and m.when.start and m.when.until for m in text.mentions)
    found = []
    for at, word in enumerate(text.words):
        if at in inside or _is_talk(text, at) or (ranged and _goes_on(text, at)):
            continue
        until = word.text == "bis" and not _reaches(text, reading, at)
        until |= word.text in _LIMITS and not _following(text, at, 2).isdisjoint(_THAN_NUMBERS)
        later = (timed and _puts_off(text, at)) or _waits(text, at)
        if word.text in LEFT or _NUMBER.fullmatch(word.text) or until or later:
            found.append(text.said(at, min(at + 4, len(text.words))))
    return found


def _reaches(text: Text, reading: Reading, at: int) -> bool:
    """Whether "bis", at word `at`, tells how much or how far: "Link bis 0,5",
    "Stau bis zum Tor"."""
    near = [word.text for word in text.words[max(0, at - _NEAR) : at]]
    for mention, role in zip(text.mentions, reading.roles, strict=True):
        if mention.first == at + 1 and mention.kind == "share":
            behind = {word.text for word in text.words[mention.last : mention.last + _NEAR]}
            falls = not _FALLS.isdisjoint({*near} | behind)
            return role == "link" or (role == "quality" and falls)
    if not _following(text, at, 1).isdisjoint({"auf", "zu"}):
        return True
    far = not _following(text, at, 1).isdisjoint({"an", "in", "vor", "zum", "zur"})
    return far and any(_EXTENDS.match(said) for said in near)


def _following(text: Text, at: int, words: int) -> set[str]:
    """The words behind word `at`, so many of them."""
    return {word.text for word in text.words[at + 1 : at + 1 + words]}


def _puts_off(text: Text, at: int) -> bool:
    """Whether something is to come after what is wished: "R2 until six, then R3"."""
    if text.words[at].text == "after":
        return _following(text, at, 1) == {"that"}
    lasting = any(m.first == at + 1 and m.when is not None and m.when.lasts for m in text.mentions)
    return not lasting and text.words[at].text in _THEN


def _goes_on(text: Text, at: int) -> bool:
    """Whether "then", at word `at`, is no other turn: "from two to four, then without R2"."""
    turns = any(m.kind == "robot" and at < m.first <= at + 2 for m in text.mentions)
    return text.words[at].text in _POINTS and not turns


def _waits(text: Text, at: int) -> bool:
    """Whether word `at` ties the wish to something of which no clock tells: "after the break"."""
    return text.words[at].text in _AFTER and not _following(text, at, 2).isdisjoint(_EVENTS)


def _refers(text: Text, at: int) -> bool:
    """Whether "then", at word `at`, only points to a time that is said: "before then", or last."""
    ends = at + 1 == len(text.words) or text.words[at + 1].text in {".", "!", ";"}
    following = [word.text for word in text.words[at + 1 : at + 3]]
    ends |= bool({*following} & {"rest", "others", "anderen"})
    robot = any(m.kind == "robot" and m.last == at for m in text.mentions)
    if [word.text for word in text.words[max(0, at - 2) : at]] == ["up", "to"]:
        return True
    return text.words[max(at - 1, 0)].text in _UP_TO or (ends and not robot)


def _is_talk(text: Text, at: int) -> bool:
    """Whether word `at` only looks as if it told a time or a number."""
    word, before = text.words[at], text.words[max(at - 1, 0)].text
    if word.text in {"hours", "days", "weeks"} and before == "for":
        return True  # "At it for hours".
    if word.text in {"hour", "hours"} and (_following(text, at, 1) & _BEGUN or before in _BUSY):
        named = before.isalpha() and before not in NAMED and before not in _OF_HOURS
        opens = text.words[max(at - 2, 0)].text
        return named and (at == 1 or opens in {",", ".", "!", ";", ":", "-", "(", "its", "is"})
    if word.text in {"week", "month", "woche", "monat"} and before in _LAST:
        return True
    if word.text in _UP_TO and _following(text, at, 1) & _POINTS:
        return True  # "Till then".
    told = {w.text for w in text.words[max(0, at - _FAR) : at]} & _TOLD
    if word.text in {"week", "month", "woche"} and before in _WHOLE and told:
        return True  # "Have been doing so all week".
    if word.text in _POINTS and _following(text, at, 1) & {"also", "so"}:
        return True  # "Is coming in then so watch the gate".
    if word.text == "feierabend" and before in _IS:
        return True
    if (
        word.text in {"after", "then", "danach", "dann"}
        and {w.text for w in text.words[at + 1 : at + 6]} & _AS_YOU_LIKE
    ):
        return True
    if word.text == "1" and before in {"prio", "prioritaet", "priority"}:
        return True
    if _NUMBER.fullmatch(word.text) and before in _PAPERS:
        return True
    if word.text in {"then", "dann"} and _refers(text, at):
        return True
    behind = text.words[at + 1] if at + 1 < len(text.words) else None
    glued = behind is not None and behind.start == word.end and behind.text.isalpha()
    return word.text.isdigit() and glued  # "5G".


def _has_part(text: Text, mention: Mention, reading: Reading) -> bool:
    """Whether it only is for whom a part of the link is kept, or who needs it."""
    words = [word.text for word in text.words[max(0, mention.first - 4) : mention.last + 9]]
    needs = {"brauchen", "braucht", "for", "fuer", "need", "needs", "weil", "because"} & {*words}
    return (
        bool({"free", "link", "save"} & {*reading.roles})
        and bool(needs)
        and "high" not in reading.roles
    )


def _is_told(text: Text, mention: Mention) -> bool:
    """Whether a part is a battery's."""
    near = text.words[max(0, mention.first - 6) : mention.last + 4]
    return bool({word.text for word in near} & lexicon.BATTERY)
