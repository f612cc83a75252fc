"""Words around cues by which a clause says something else than they do: ask back.

"Leave R1 in" leaves nobody out, "without R1 nothing works" wishes for R1, "a third less" is no
bound of a third, and behind "until five, I mean six" nobody knows which of both counts.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.cues import resources, robots
from llm_gateway.wishes.numbers import NAMED

_END = r"(?: (?:bitte|please|for now|now|TIME))*$"
_GROUP = (
    r"(?:fleet|fusion|game|group|line ?up|list|loop|mix|picture|play|pool|rotation|roster|running|"
    r"sharing|swarm|team)"
)
_STAYS = re.compile(
    r"\bleav\w* ROBOT (?:\w+ )?(?:(?:active|as (?:he|it|she) is|as is|enabled|in|on|running)"
    rf"{_END}|(?:in|on|within) (?:our |the )?{_GROUP}\b|to (?:do|go on|handle|run|work)\b)|"
    r"\bleav\w* (?:everything|it|that|them|things|this) (?:all )?to ROBOT\b|"
    r"\b(?:leav\w*|let) ROBOT (?:carry|cope|do|drive|go(?! (?:ahead|before|first))|handle|join|"
    r"manage|run|take(?! the lead)|work)\b"
)
"""Leaves somebody where he is, or something to him."""
_ABSENCE = (
    r"(?:absence|break|danger|hospital|leave|maintenance|pause|quarantaene|quarantine|repairs?|"
    r"reparatur|retirement|urlaub|wartung|werkstatt|workshop)"
)
_RETURNS = re.compile(
    rf"\b(?:aus|out of) (?:de[mnr] |the )?{_ABSENCE}\b|"
    r"\b(?:from|off|on to|onto|von) (?:de[mnr] |our |the )?(?:(?:black|ban|block|injured|injury|"
    r"sick|skip)(?: ?list)|bench|schwarze\w* liste|sperrliste)\b|"
    rf"\b{_ABSENCE} (?:is |ist )?(?:beendet|done|ended|finished|over|rum|vorbei|vorueber|"
    r"zu ende)\b"
)
"""Was away, and is no more."""
_NEEDED = re.compile(
    r"\b(?:ohne|without) (?:(?:den|die|das|the) )?ROBOT\b.*\b(?:aufgeschmissen|cant|cannot|fails?|"
    r"falls? apart|impossible|klappt|lost|nichts?|niemand|nix|no one|nobody|nothing|unmoeglich|"
    r"useless|verloren|wont)\b|\b(?:aufgeschmissen|cant|cannot|impossible|lost|nichts|niemand|nix|"
    r"no one|nobody|nothing|unmoeglich|useless|verloren|wont)\b.* (?:ohne|without) "
    r"(?:(?:den|die|das|the) )?ROBOT\b"
)
"""Wishes for whom it seems to do without."""
_SELDOM = re.compile(
    r"\b(?:hardly|kaum|rarely|scarcely|seldom|selten)(?: ever| je)? "
    r"(?:aus|ignored|off|out|skipped|weg)\b"
)
_SOME_OF = re.compile(
    r"\b(?:any|either|ein(?:e[mnrs]?)?|half|most|one|some|three|two|drei|welche|zwei)(?: out)?"
    r" (?:of|von|aus)(?: (?:den|the))? ROBOT\b|\bROBOT (?:or|oder)(?: \w+)? ROBOT\b"
)
"""Some of those that are named: nobody knows which."""
_ONWARDS = re.compile(
    r"\bROBOT (?:and|und|or|oder) (?:above|below|beyond|down|higher|lower|up|upwards?|hoeher|"
    r"niedriger|aufwaerts)\b|\bROBOT (?:aufwaerts|onwards?|upwards?)\b|"
    r"\b(?:ab|from|von) ROBOT (?:alle|an|aufwaerts|on|onwards?|up|upwards?)\b|"
    r"\b(?:all\w*|every\w*|robots?|roboter) (?:\w+ )?(?:above|after|below|beyond|bis(?: zu)?|ueber|"
    r"unter|up to) ROBOT\b"
)
"""Names where a row of robots begins or ends."""
_BRIEFLY = re.compile(
    r"\b(?:ask|fragt?|nehmt?|nimm|nutzt?|take|use)\b.* (?:bloss|just|lediglich|nur|only) TIME\b|"
    r"\bROBOT (?:bloss|lediglich|nur) TIME(?: [a-z]+)?$"
)
"""Of when, not of whom, it says "only"."""
_STILL_IN = re.compile(
    r"(?:(?:but|aber|though|jedoch|however) )*(?:keep ROBOT(?: in| on)?|(?:der |die |das )?ROBOT "
    r"(?:(?:bleibt|remains|stays)(?: \w+)?|(?:is|ist) (?:allowed|back|fine|good|in|ok|okay|noch "
    r"dabei|dabei|wieder da)|can stay|darf bleiben|drin|dabei|in|may stay|not|nicht|rein))"
    r"(?: (?:aber|bitte|however|please|though|TIME|too))*"
)
"""Takes one of those who are left out back in."""

_NUMBER = "(?:" + "|".join(sorted(word for word, n in NAMED.items() if n > 1)) + ")"
_STOP = r"(?: [,;:.–—-])*"
_BETTER = (
    r"(?:actually|better|besser|doch(?: lieber)?|eher|halt|i mean|ich meine?|lieber|"
    r"make (?:it|that)|nein|nee|no|oder(?: besser| doch)?|oops|or(?: better| rather)?|pardon|"
    r"quatsch|rather|sorry|wait|well)"
)
_RATHER = (
    r"(?:actually|better|besser|doch(?: lieber)?|eher|i mean|ich meine?|lieber|"
    r"make (?:it|that)|oops|pardon|quatsch|rather|sorry|wait|well)"
)
_CORRECTED = re.compile(
    rf"\bTIME{_STOP}(?: {_BETTER}{_STOP})+ {_NUMBER}\b(?! (?:CLASS|PLACE|ROBOT|SHARE))|"
    rf"\bTIME (?:and|und|,) {_NUMBER}(?: (?:at the latest|max\w*|please|bitte|spaetestens|tops))?"
    rf"(?: [,.;!]|$)|\b(?:for|fuer) {_NUMBER}(?: [,.;!]|$)|"
    rf"\bROBOT(?: ,)? (?:and|or|oder|und|,) {_NUMBER}(?: (?:and|or|oder|und|,) {_NUMBER})*"
    r"(?: (?:out|off|raus|weg|aus|more|mehr|others?|weitere\w*))?(?: [,.;!]|$)|"
    rf"\bROBOT(?: (?:alone|aus|first|out|raus|weg|zuerst))?{_STOP} {_RATHER}{_STOP}"
    r"(?: (?:den|der|die|just|nur|only|the))? ROBOT\b(?! (?:as|als)\b)|"
    r"\bROBOT(?: \.){2,} ROBOT\b|\bROBOT … ROBOT\b|"
    r"\bROBOT (?:or|oder) (?:better|doch|maybe|perhaps|rather|vielleicht) ROBOT\b"
)
"""Says one thing, and then perhaps another one in its place."""
_UNNAMED = re.compile(
    r"\bROBOT(?: ,)? (?:and|or|oder|plus|sowie|und) (?:"
    r"(?:all|alle|any|beide|both|das|den|der|die|each|every|jede[nr]?|the) "
    r"(?!(?:andere?n?|other|others|remaining|rest|restlichen|same|uebrigen)\b)[a-z]+ "
    r"(?:bots?|machines?|ones?|robots?|roboter|units?)|(?:all|beide|both|the|die) newcomers|"
    r"(?:a few|another|ein paar|noch|one|some) (?:ein\w*|mehr|more|others?|weitere\w*)|"
    r"whichever|who(?:m|so)?ever|wer (?:auch|immer|langsam|sonst)|"
    r"above|aufwaerts|below|beyond|higher|lower|up|upwards?)\b"
)
"""Goes on with robots that have no name."""
_REPEATED = re.compile(
    r"\b(?:every|each|jede[nrs]?) (?:TIME|abend|afternoon|day|evening|morgen|morning|nacht|night|"
    r"shift|schicht|tag|week|woche)\b|\bnightly\b"
)
_ALL_DAY = re.compile(
    r"\b(?:rest of (?:the|this|my|our) (?:\w+ )?(?:day|shift|week)|all day|"
    r"(?:the |this )?(?:entire|whole) (?:day|night|shift|week)|den ganzen tag|"
    r"die ganze (?:nacht|schicht|woche)|rest (?:der|des|vom) (?:nacht|schicht|tag\w*|woche))\b"
)
"""Ends, or comes again, when no clock tells."""
_TOLD = re.compile(
    r"\b(?:been|gewesen|had|has|hat|hatte|have|is|ist|lief|ran|runs?|sind|war|waren|was|were)\b"
)
_EXCEPTED = re.compile(
    r"(?:\bROBOT\b.* (?:niemand sonst|no ?one else|nobody else|sonst (?:keiner|niemand))|"
    r"\b(?:nur|only) ROBOT)\b.* (?:ausser|except)(?: for)? ROBOT\b|"
    r"^(?!.*\bROBOT\b.*\bROBOT\b)(?!.*\b(?:all\w*|any|every\w*)\b).*\bSHARE\b.* "
    r"(?:ausser|except)(?: for)? ROBOT\b"
)
"""Makes an exception of what is none."""
_OPPOSED = re.compile(
    r"\b(?:ask|fragt?|nutzt?|query|use|verwendet?) (?:\w+ )?ROBOT (?:never|nie|off|out|raus|weg)\b"
)
"""What begins as a list of those who are asked ends with who is out."""
_NO_BOUND = re.compile(
    r"\b(?:another|by(?: about| another| up to)?|um(?: etwa| rund| weitere)?|weitere) SHARE\b|"
    r"\bSHARE (?:below|better|besser|faster|fewer|higher|hoeher|langsamer|less|lower|mehr|"
    r"more|schneller|schlechter|slower|weniger|worse)\b(?! (?:als|is|ist|than)\b)|"
    r"\bALLBUT SHARE\b|\b(?:or|oder) (?:besser|better|lieber|rather) SHARE\b"
)
"""Tells of a change, not of a bound."""
_SAVED = re.compile(
    r"\b(?:cut|einspar\w*|reduce|reduzier\w*|sav(?:e|ing)|senk\w*|spar(?:e|en|t)?)(?: (?:bitte|"
    r"down|NET|please|the))* SHARE\b"
)
"""Tells how much is to be saved: what is left is all but that."""
_TOO = re.compile(
    r"\b(?:is|are|ist|sind)? ?(?:far )?(?:too|zu) (?:few|hoch|high|little|low|much|niedrig|viel|"
    r"wenig)\b|\b(?:not|nicht) (?:enough|genug)\b|\breich(?:en|t) nicht\b|\bisnt enough\b"
)
_HAPPENS = re.compile(
    r"\b(?:already|bereits|currently|derzeit|momentan|right now|schon)\b.*\bSHARE\b|"
    r"\bSHARE\b.* (?:are|is|ist|sind|werden|wird) (?:\w+ )?(?:"
    r"(?:belegt|busy|down|full|genutzt|taken|used|weg)$|(?:broken|gone|kaputt|lost|verloren)\b)|"
    r"\b(?:dropped|faellt|fallen|fell|fiel|gefallen|gesunken|gone|lost|rose|sank|stieg|"
    r"verloren) (?:\w+ )?SHARE\b|\b(?:has|hat) (?:a |an |eine |ein )?(?:\w+ )?(?:of|von) SHARE\b"
)
"""Tells how things are."""
_OURS = re.compile(
    r"\b(?:i|ich|we|wir) (?:brauch\w*|need)(?: \w+)? SHARE\b(?!.*\b(?:for|frei\w*|free|fuer)\b)|"
    r"\b(?:gebt?|gib|give|lasst?|leave|spare) (?:me|mir|us|uns) SHARE\b"
    r"(?!.*\b(?:for|frei\w*|free|fuer)\b)"
)
"""Whoever speaks may be one of the swarm, or one of the others."""
_REFUSED = re.compile(
    r"\b(?:do not|dont|never|nie|niemals)(?: (?:nehmt|nutzt|take|use))? SHARE\b|"
    r"\b(?:not even|nicht einmal|nicht mal) SHARE\b|"
    r"\bSHARE\b.* (?:darf nicht|duerfen nicht|may not|must not|mustnt|shall not|should not) "
    r"(?:be )?(?:belegt|genommen|genutzt|taken|used|verwendet)\b"
)
_HALF = 0.5


def turned(text: str) -> bool:
    """Whether a clause that names robots says other of them than its cues."""
    return bool(
        (_STAYS.search(text) and robots.OUT.search(text))
        or _RETURNS.search(text)
        or _NEEDED.search(text)
        or _SELDOM.search(text)
        or _ONWARDS.search(text)
        or _BRIEFLY.search(text)
        or _OPPOSED.search(text)
        or (_SOME_OF.search(text) and not negated(text))
    )


def stays(text: str) -> bool:
    """Whether a clause takes a robot back in that another one leaves out."""
    return bool(_STILL_IN.fullmatch(text))


def unbounded(text: str, value: float, *, linked: bool) -> bool:
    """Whether the part of this value that a clause names bounds nothing, or nobody knows what;
    `linked`: of the link."""
    bounded = resources.AT_MOST.search(text) or resources.AT_LEAST.search(text)
    if not bounded and (_TOO.search(text) or _HAPPENS.search(text) or _REFUSED.search(text)):
        return True
    # Whether so much is taken, or so much is left, makes no difference for a half.
    split = value != _HALF and (_SAVED.search(text) or _OURS.search(text))
    return bool(_NO_BOUND.search(text) or (linked and split))


def doubt_traps(draft: Draft) -> None:
    """Asks back about all of a wish that corrects itself, or goes on with robots without names."""
    said = draft.text.capitals()
    for clause in draft.clauses:
        timed = _REPEATED.search(clause.text) or _ALL_DAY.search(clause.text)
        if timed and not _TOLD.search(clause.text) and clause.mentions:
            draft.doubt(clause, firmly=True)
    if _CORRECTED.search(said) or _UNNAMED.search(said) or _EXCEPTED.search(said):
        draft.firm.append(draft.text.whole)
