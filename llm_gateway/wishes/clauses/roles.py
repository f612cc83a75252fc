"""What one clause says of the robots that it names, by its cue words."""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.clauses.turned import turned
from llm_gateway.wishes.clauses.weighing import weight_role
from llm_gateway.wishes.cues import common, fleet, robots
from llm_gateway.wishes.cues.plain import bare, known, strange
from llm_gateway.wishes.reading import Role

_TWICE = re.compile(
    r"\b(?:never|dont|do not|not|nie|nicht)\b.*\b(?:nobody|no ?one|none|niemand\w*|keine[nr]?)\b"
)
_REFUSED = re.compile(r"(?:and |but |und |aber )?(?:no|nope|not|nein|nicht|nich|net|ned)")
_NOBODY_ELSE = re.compile(
    r"\b(?:ausser|except|besides|apart from|bis auf) (?:(?:der|dem|den|die|"
    r"the) )?ROBOT\b.*\b(?:keine[rn]?|niemand\w*|nobody|no ?one)\b"
)
_ALL_OUT_BUT = re.compile(
    r"^(?:please |bitte )?(?:exclude|skip|ignore|drop|leave out|bench|disregard|ignoriert?|"
    r"schliesst?) ALLBUT (?:\w+ )?ROBOT\b"
)
_NOT_ONLY = re.compile(r"\b(?:dont|do not|not|never|nicht) (?:bloss|just|merely|nur|only|purely)\b")
_OVER = re.compile(
    r"\b(?:over|than|als|statt|anstatt|instead of|anstelle von|in preference to) (?:(?:the|den|die|"
    r"das|der) )?ROBOT\b"
)
"""To the robot something else is preferred."""
_RECENTLY = re.compile(
    r"\b(?:nur(?: noch)?|only|just)(?: [a-z]+){0,2} SHARE\b|\bonly (?:just|now|recently|"
    r"yesterday)\b|\b(?:have|has|just) only\b|\bnur (?:kurz|eben|schnell)\b|^(?:nur|just|only|"
    r"bloss) (?:um|so|to|because|weil|damit)\b"
)
"""Tells how long ago, or why."""
_LOW_PRIORITY = re.compile(
    r"\b(?:bottom|gering\w*|keine|kleinste|last|least|less|little|low|lower|lowest|niedrig\w*|no|"
    r"weniger|wenig|zero) (?:\w+ )?(?:preference|prioritaet|priority|vorrang|vorzug)\b"
)
"""Of a robot no field of an intent says so."""
_BY_NOBODY = re.compile(r"\b(?:keiner|niemand|no ?one|nobody)\b(?! (?:else|sonst)\b)")
_PREFERS = re.compile(r"\b(?:prefer\w*|first|bevorzug\w*|zuerst|vorrang|favou?r\w*|priori\w*)\b")
_NOT_AT_ALL = re.compile(
    r"(?:bitte |please |besser |lieber |better )?(?:not(?: at all)?|nicht|bloss nicht|gar nicht|"
    r"auf keinen fall|no)(?: bitte| please)?"
)
_RATHER = re.compile(r"\b(?:lieber|rather)\b(?! (?:als|than)\b)")
"""Beside what leaves a robot out it prefers none: "den lasst lieber weg"."""
_SAVE_FOR = re.compile(r"\b(?:except|ausser|but|besides|bis auf)\b")
_TURNED = re.compile(
    r"\b(?:nobody|no ?one|keiner|niemand)\b(?: \w+){0,3} (?:skip|ignore|exclude|leave|drop|avoid|"
    r"ROBOT (?:weg|aus|ignor)\w*)|\b(?:skip|ignore|exclude|drop|avoid) (?:nobody|no ?one|none)\b|"
    r"\b(?:aufhoer\w*|cease|hoert? auf)\b.* (?:auszulassen|auszuschliessen|ignore|rauszu\w+|"
    r"wegzulassen|zu ignorieren)\b|\b(?:hoert? auf) (?:allein|nur|ROBOT allein)\b|\b(?:stop|quit|"
    r"cease) (?:skipp|ignor|exclud|leav|avoid|omitt|dropp|bench)\w*|\b(?:should|could|"
    r"would) have\b|\b(?:so|too|very|zu) (?:haeufig|oft|often)\b|\bevery (?:other|second) time\b|"
    r"\b(?:do not|does ?nt|dont|nicht|nobody|not|shouldnt)\b.*\b(?:at the same time|both|"
    r"every time|for everything|fuer alles|jedes mal|(?:so|too) (?:hard|much|quickly|schnell|"
    r"viel))\b|\bnicht beide\b|\balways\b|(?<!wo )(?<!wann )\bimmer\b|\bthe only (?:one|robot|"
    r"bot)\b|\b(?:is|are) left\b(?! out)|\bleft is\b|\b(?:ist|sind) (?:noch )?da\b|\b(?:der|die|"
    r"das) einzigen?\b|\bout and about\b"
)
"""Words that turn around what is said of a robot, or tell how things are."""
_AT = re.compile(
    r"\b(?:at|in|on|near|around|for|from|im|am|an|bei|beim|auf|fuer|vor|that|which|what|"
    r"where)(?: \w+){0,2} (?:PLACE|CLASS)\b|\b(?:PLACE|CLASS) (?:that|which|die|das|den)\b"
)
_NONE_OF = re.compile(r"\b(?:none of (?:our|the)|kein\w* (?:der|von den|unserer)) ([a-z]{3,})\b")
_USES = re.compile(
    r"\b(?:nobody|no ?one) (?:can|is to|may|must|shall|should) (?!be\b)\w+ (?:a|an|beyond|more|our|"
    r"over|the)\b"
)
"""Forbids people something: "nobody should use the lift"."""
SHORT = 4
"""Words of a clause that says one thing only."""
_ALWAYS = re.compile(
    r"^((?:(?:please|bitte|and|und|but|aber|also|so|then|dann) )*)always (?=(?:ask|use|try|take|"
    r"start|begin|choose|pick|go|query|prefer)\b.*\b(?:first|prefer\w*|with)\b)|^((?:(?:bitte|"
    r"please|und|aber|also|dann|fragt?|nehmt|nimm|nutzt?|benutzt?|"
    r"verwendet?) )*(?:ROBOT (?:bitte )?)?)immer (?=(?:zuerst|erst|als erste\w*|bevorzugt|"
    r"lieber)\b(?: (?:bei|mit|an|den|die|das|der))*(?: ROBOT\b| (?:fragen|nehmen|anfragen|nutzen|"
    r"benutzen|verwenden)))"
)
"""Wishes for always, rather than tells how it always is: "immer zuerst R2 fragen"."""


def nobody(text: str) -> bool:
    """Whether a clause wishes that no robot at all is asked."""
    found = fleet.NOBODY.search(text)
    if found is None or "ROBOT" in text or fleet.OTHERS.search(text.replace(found[0], " ")):
        return False
    if _TWICE.search(found[0]) or re.search(r"[A-Z]{3}BUT|\bUNKNOWN\b", text):
        return False
    if _USES.search(text):
        return False
    some = _NONE_OF.search(text)
    if some is not None and not known(some[1]):
        return False  # "None of the scouts".
    return not fleet.SOMEBODY.search(text)


def robot_role(text: str, *, alone: bool = False) -> Role | None:
    """What a clause says of the robot that it names; `alone`: it names none."""
    if robots.BUT_NOT.search(text):
        return "out"
    if _ALL_OUT_BUT.search(text):
        return "only"
    if robots.CONTRAST.search(text):
        return "doubt"
    if _turned(text) or turned(text):
        return "doubt"
    if _NOT_ONLY.search(text) or ("NOBODYBUT" in text and robots.OUT.search(text)):
        return None if alone else "doubt"
    if "NOBODYBUT" in text:
        return "doubt" if negated(text.replace("NOBODYBUT", " ")) else "only"
    if _NOBODY_ELSE.search(text):
        return "only"
    plain = robots.OVER_OTHERS.sub("first", _RECENTLY.sub(" ", text))
    plain = robots.ONLY.sub("ONLYTHESE", plain)
    if "ONLYTHESE" in plain:
        plain = re.sub(r"\bROBOT (?:alone|allein)\b", "ROBOT", plain)
    out = bool(robots.OUT.search(plain))
    bare = re.search(r"\balone\b", text) and not re.search(r"\b(?:l?e?av\w*|lev|let|left)\b", text)
    no = negated(robots.NOT_BUT_OUT.sub(" ", plain)) if "ALLBUT" not in text else False
    only = "ONLYTHESE" in plain
    first = bool(robots.FIRST.search(_RATHER.sub(" ", plain) if out else plain))
    if first and (_LOW_PRIORITY.search(plain) or _BY_NOBODY.search(plain)):
        return "doubt"
    unused = bool(robots.UNUSED.search(plain))
    if (bare and not only) or (no and (out or only or first)) or robots.LAST.search(text):
        return None if alone else "doubt"
    if alone and _NOT_AT_ALL.fullmatch(text):
        return "out"
    hits: set[Role] = set()
    if out or (no and (unused or not alone)):
        hits.add("out")
    if only:
        hits.add("only")
    if first:
        hits.add("first")
    if alone and hits == {"first"} and not unused and not _PREFERS.search(plain):
        return None
    if not hits and not alone:
        if robots.JUST.search(text):
            return "only"
        return "first" if robots.POSSIBLY.search(text) else None
    if hits == {"out"} and alone and not (common.PRONOUN.search(text) or no or _plain_out(text)):
        return None
    backup = hits == {"only"} and fleet.BACKUP.search(text) and not fleet.OTHERS.search(text)
    if backup or (hits == {"first"} and text.count("ROBOT") == 1 and _OVER.search(text)):
        return "doubt"
    return hits.pop() if len(hits) == 1 else ("doubt" if hits else None)


def _plain_out(text: str) -> bool:
    return len(text.split()) <= SHORT


def _turned(text: str) -> bool:
    """Whether words turn around what a clause says of a robot, or only report it."""
    if _TURNED.search(_ALWAYS.sub("", text)):
        return True
    rest = text.replace("ALLBUT", " ")
    if rest == text:
        every = re.search(r"\b(?:all|alle|every\w*)\b", text) and _SAVE_FOR.search(text)
        rest = _SAVE_FOR.sub(" ", text) if every else ""
    return bool(robots.OUT.search(rest)) or (rest != "" and negated(rest))


def asks(text: str) -> bool:
    """Whether a clause says that somebody is to be asked: "R1 must be asked"."""
    used = robots.UNUSED.search(text) or robots.DEMANDED.search(text)
    return bool(used) and not (negated(text) or robots.OUT.search(text))


def certain(text: str, role: Role) -> bool:
    """Whether a clause that leaves a robot out, or asks nobody else, says so plainly.

    All its words must be known; a negation alone must negate nothing but the robot; and it must
    not say so of a place only: "skip R3 at the docks".
    """
    there = _AT.search(text) and weight_role(text) != "high"
    but = re.search(r"\b(?:ALLBUT|NOBODYBUT|except|besides|ausser|apart)\b", text)
    if strange(text, ailing=role == "out" and not but) or there:
        return False
    cue = robots.OUT.search(text) or robots.UNUSED.search(text) or robots.ONLY.search(text)
    return role == "only" or bool(cue) or "BUT" in text or bare(text)


def others_role(text: str) -> Role | None:
    """What a clause says of the robots named beside it, by what it says of all the others."""
    if not fleet.OTHERS.search(text) or re.search(r"\b(?:NOBODYBUT|ALLBUT)\b", text):
        return None
    plain = fleet.OTHERS.sub(" ", text, count=1)
    if _REFUSED.fullmatch(plain.strip()):
        return "only"
    if fleet.BACKUP.search(plain):
        return "first"
    out = robots.OUT.search(plain) or fleet.IDLE.search(plain)
    no = negated(plain)
    if (out and not no) or (no and not out and robots.UNUSED.search(plain)):
        return "only"
    return None
