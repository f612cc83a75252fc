"""What a wish says of itself: corrections, conditions, exceptions, and robots without names.

Behind "until five, I mean six" nobody knows which of both counts, and "skip R3, if it rains" is no
wish for now: the whole is asked back, whatever a model says of it.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.draft import Draft
from llm_gateway.wishes.numbers import NAMED
from llm_gateway.wishes.reading import Role

_NUMBER = "(?:" + "|".join(sorted(word for word, n in NAMED.items() if n > 1)) + ")"
_STOP = r"(?: [,;:.–—-])*"
_BETTER = (
    r"(?:actually|better|besser|doch(?: lieber)?|eher|halt|i mean|ich meine?|lieber|make (?:it|"
    r"that)|nein|nee|no|oder(?: besser| doch)?|oops|or(?: better| rather)?|pardon|quatsch|rather|"
    r"sorry|wait|well)"
)
_RATHER = (
    r"(?:actually|better|besser|doch(?: lieber)?|eher|i mean|ich meine?|lieber|make (?:it|that)|"
    r"oops|pardon|quatsch|rather|sorry|wait|well|(?:(?:no|nein) )?(?:hang on|moment|wait|warte))"
)
_CORRECTED = re.compile(
    rf"\bTIME{_STOP}(?: {_BETTER}{_STOP})+ {_NUMBER}\b(?! (?:CLASS|PLACE|ROBOT|SHARE))|"
    rf"\bTIME (?:and|und|,) {_NUMBER}(?: (?:at the latest|max\w*|please|bitte|spaetestens|tops))?"
    rf"(?: [,.;!]|$)|\b(?:for|fuer) {_NUMBER}(?: [,.;!]|$)|"
    rf"\bROBOT(?: ,)? (?:and|or|oder|und|,) {_NUMBER}(?: (?:and|or|oder|und|,) {_NUMBER})*"
    r"(?: (?:out|off|raus|weg|aus|more|mehr|others?|weitere\w*))?(?: [,.;!]|$)|"
    rf"\bROBOT(?: (?:alone|aus|first|out|raus|weg|zuerst))?(?:{_STOP} {_RATHER})+{_STOP}"
    r"(?: (?:den|der|die|just|nur|only|the))? ROBOT\b(?! (?:as|als)\b)|"
    r"\bROBOT(?: \w+)? \( ROBOT !? ?\)|"
    rf"\bTIME(?: \w+)? \( {_NUMBER} \)|"
    r"\bROBOT(?: \.){2,} ROBOT\b|\bROBOT … ROBOT\b|\bROBOT (?:or|oder) (?:better|doch|maybe|"
    r"perhaps|rather|vielleicht) ROBOT\b"
)
"""Says one thing, and then perhaps another one in its place."""
_UNNAMED = re.compile(
    r"\bROBOT(?: ,)? (?:and|or|oder|plus|sowie|und) (?:(?:all|alle|any|beide|both|das|den|der|die|"
    r"each|every|jede[nr]?|the) (?!(?:andere?n?|other|others|remaining|rest|restlichen|same|"
    r"uebrigen)\b)[a-z]+ (?:bots?|machines?|ones?|robots?|roboter|units?)|(?:all|beide|both|the|"
    r"die) newcomers|(?:a few|another|ein paar|noch|one|some) (?:ein\w*|mehr|more|others?|"
    r"weitere\w*)|whichever|who(?:m|so)?ever|wer (?:auch|immer|langsam|sonst)|above|aufwaerts|"
    r"below|beyond|higher|lower|up|upwards?)\b"
)
"""Goes on with robots that have no name."""
_EXCEPTED = re.compile(
    r"(?:\bROBOT\b.* (?:niemand sonst|no ?one else|nobody else|sonst (?:keiner|niemand))|\b(?:nur|"
    r"only) ROBOT)\b.* (?:ausser|except)(?: for)? ROBOT\b|"
    r"^(?!.*\bROBOT\b.*\bROBOT\b)(?!.*\b(?:all\w*|any|every\w*)\b).*\bSHARE\b.* (?:ausser|"
    r"except)(?: for)? ROBOT\b"
)
"""Makes an exception of what is none."""
_ALL_BUT = re.compile(
    r"\b(?:all\w*|any\w*|every\w*|jede\w*)\b(?! (?:anderen|others?|"
    r"uebrigen)\b)(?:(?! ROBOT)[^.;!])*\b(?:alone|aus|avoid|away|abschalten|exclude|ignore|off|out|"
    r"raus|ruhe|skip|weg\w*)\b(?:(?! ROBOT)[^.;!])*\b(?:ausser|bis auf|bloss|but|except|just|nur|"
    r"save)(?: for)?(?: not| nicht)? ROBOT\b|\b(?:bench|drop|exclude|ignore|skip) (?:all|"
    r"every)\w*(?:(?! ROBOT)[^.;!])*, (?:but|except)(?: for)? ROBOT\b|\bROBOT (?:\w+ )?(?:aus|off|"
    r"out|raus|weg)\b[^.;!]* (?:ausser|bis auf|except)(?: for)? ROBOT\b"
)
"""All but somebody are out: his is the only name."""
_NONE_BUT = re.compile(
    r"\b(?:none of (?:our|the|them)(?: \w+)?|keine\w* (?:der|von den|unserer) \w+) (?:apart from|"
    r"ausser|besides|but|except(?: for)?|other than) ROBOT\b|\b(?:kein\w*|niemand|no|no ?one|"
    r"nobody)(?: \w+)? (?:is|ist) (?:aus|off|out|raus|weg) (?:apart from|ausser|but|"
    r"except(?: for)?) ROBOT\b|^(?:apart from|ausser|bis auf|"
    r"except(?: for)?) ROBOT\b(?=[^.;!]*\b(?:aus|bench|dont|drop|exclude|ignore|leave|not|out|raus|"
    r"skip|weg)\b)[^.;!]*\b(?:all\w*|any\w*|every\w*)\b"
)
"""Says of all but somebody that they are out, or that none is."""
_EITHER = re.compile(
    r"^(?!.*\b(?:do not|dont|never|nicht|no|without)\b).*\b(?:(?:one of (?:them|the (?:three|two))|"
    r"einen? (?:davon|von (?:beiden|euch|ihnen)))\b.* ROBOT\b|(?:either|entweder) ROBOT\b)|"
    r"\b(?:aufhoeren|cease|hoert? auf) , .*\b(?:allein|auszulassen|auszuschliessen|ignorieren|nur|"
    r"rauszunehmen|wegzulassen)\b"
)
"""Leaves open who is meant; or tells to stop what is said behind it."""
_ANSWERED = re.compile(
    r"\bROBOT\b[^?.!]*\? (?:(?:besser|lieber) )?(?:nein|nicht|no|nope)\b|"
    r"\bROBOT\b[^?.!]*, (?:isnt (?:he|it|she)|oder|right) \?"
)
"""Asks, and says no to it."""
_TROUBLE = re.compile(
    r"^wenns (?!beliebt|euch|geht|keine|moeglich|nichts|nix|passt|recht)\w+\b|\bbei (?:gewitter|"
    r"nebel|paketverlust\w*|schnee\w*|sturm)\b"
)
"""Says in which weather, or in what trouble, something is wished."""
_REPEATED = re.compile(
    r"\b(?:every|each|jede[nrs]?) (?:TIME|abend|afternoon|day|evening|morgen|morning|nacht|night|"
    r"shift|schicht|tag|week|woche)\b|\bnightly\b"
)
_ALL_DAY = re.compile(
    r"\b(?:rest of (?:the|this|my|our) (?:\w+ )?(?:day|shift|week)|all day|(?:the |"
    r"this )?(?:entire|whole) (?:day|night|shift|week)|den ganzen tag|die ganze (?:nacht|schicht|"
    r"woche)|rest (?:der|des|vom) (?:nacht|schicht|tag\w*|woche))\b"
)
"""Ends, or comes again, when no clock tells."""
_TOLD = re.compile(
    r"\b(?:been|gewesen|had|has|hat|hatte|have|is|ist|lief|ran|runs?|sind|war|waren|was|were)\b"
)
_IN_CASE = re.compile(
    r"\b(?:bei|during(?: the)?|im|im falle(?: eine[rs])?|in(?: case of)?(?: an?)?|on|"
    r"while(?: in)?) (?:alarm\w*|brandfall|danger|emergenc\w+|feuer\w*|fire(?: alarm| drill)?|"
    r"gefahr|notfall\w*|stoerung\w*|zweifel)\b|\b(?:bei|nach) bedarf\b|\bnotfalls\b|\b(?:at|"
    r"on) my (?:command|signal)\b|\bauf (?:mein )?kommando\b|\b(?:as|so) long as\b|"
    r"\bsolange\b(?! (?:ich nichts anderes|bis)\b)|\b(?:waehrend|while) (?!TIME)(?:(?:ROBOT|der|"
    r"die|das|he|i|ich|it|she|the|they|wir|we)\b|\w+ing\b)|\bROBOT only (?:after|for|"
    r"with) (?!TIME)|\bbei regen\b|\bim regen\b"
)
"""Says in which case something is wished, or as long as something else lasts."""
_IF = re.compile(r"\b(?:falls|if|sofern|unless)\b")
_LATER = re.compile(
    r"\b(?:for (?:a while|one round|this round)|for the next (?:delivery|round)|fuer eine runde|"
    r"fuer diese (?:lieferung|runde)|next time|now and then|ab und zu|most of the time|"
    r"mindestens TIME|at least TIME)\b"
)
"""Ends, or comes, when no clock tells."""
_POLICY_IS = re.compile(
    r"\bPOLICY (?:decides now|entscheidet gerade)\b|\b(?:changed|switched) to POLICY$|\b(?:jemand|"
    r"somebody|someone|they)(?: has| hat)? .*\bPOLICY\b|\b(?:is|ist) POLICY$"
)
"""Tells which policy decides."""
_BEGS = re.compile(r"\b(?:bitte|can|could|kann\w*|koenn\w*|please|wollt|wuerd\w*|would|will)\b")
_SHORT = 5
"""Words and signs of a question that asks nobody for anything: "R3 out?"."""
_HARD: frozenset[Role] = frozenset({"out", "only", "quality", "link", "free", "policy"})


def doubt_traps(draft: Draft) -> None:
    """Asks back about what a wish wishes under a condition, corrects, or leaves open."""
    said = draft.text.capitals()
    for clause in draft.clauses:
        timed = _REPEATED.search(clause.text) or _ALL_DAY.search(clause.text)
        if timed and not _TOLD.search(clause.text) and clause.mentions:
            draft.doubt(clause, firmly=True)
    asked = said.endswith("?") and len(said.split()) <= _SHORT and not _BEGS.search(said)
    if asked and not {"out", "only"}.isdisjoint(draft.roles):
        draft.firm.append(draft.text.whole)
    traps = [_CORRECTED, _UNNAMED, _EXCEPTED, _ALL_BUT, _NONE_BUT, _EITHER, _ANSWERED]
    if draft.nobody or not _HARD.isdisjoint(draft.roles):
        ends = any(
            m.when is not None and m.when.clear and (m.when.until or m.when.lasts)
            for m in draft.text.mentions
        )
        # Beside an end, "while" and "when" only tell why; a bound may hold for a while.
        firmly = [c for c in draft.supposed if not ends or _IF.search(c.text)]
        asks = draft.nobody or not {"out", "only"}.isdisjoint(draft.roles)
        traps += [_IN_CASE, _TROUBLE] if asks and not ends else []
        traps += [_LATER, _POLICY_IS]
        draft.firm += [draft.text.whole] if firmly else []
    if any(trap.search(said) for trap in traps):
        draft.firm.append(draft.text.whole)
