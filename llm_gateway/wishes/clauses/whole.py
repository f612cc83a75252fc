"""Wishes that say as a whole who alone is asked, or who is not: "leave everyone out, except R1",
"R1 is all we need", "let R1 charge", "would you mind leaving R1 out?".

Clause by clause the name stands beside words for all the others, or beside none that are plain. So
such a wish is read as a whole, and only where nothing else is said in it but for how long.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.reading import Reading, Role

_ALL = (
    r"(?:(?:all|alle|jeden|saemtliche|them all)(?: (?:of them|(?:of )?(?:die |our |the )?"
    r"(?:robots?|roboter)))?|every(?:body|one)|every robot|jeden roboter)"
)
_ANYBODY = r"any(?:body|one| robots?)"
_NOBODY = r"(?:kein(?:en?|e)?(?: (?:robots?|roboter))?|niemand(?:en)?|no(?: one|body|ne| robots?))"
_ROBOT = r"(?:(?:das|de[mnr]|die|the) )?ROBOT"
_BUT = (
    r"(?:, )?(?:apart from|ausser|bis auf|but|except(?: for| from)?|mit ausnahme von|other than|"
    rf"save(?: for)?) {_ROBOT}"
)
_JUST = rf"(?:, )?(?:bloss|just|nur|only) {_ROBOT}"
_JUST_NOT = rf"(?:, )?(?:bloss|just|nur|only)(?: not {_ROBOT}| {_ROBOT} nicht)"
_PUTS = (
    r"(?:halte[tn]?|keep|lass(?:en|t)?|leave|nehm(?:en|t)|nimm|put|schalte[tn]?|shut|switch|take|"
    r"turn)"
)
_OUT = (
    r"(?:abschalten|alone|aside|aus|aus dem spiel|aussen vor|aussen vor lassen|auslassen|"
    r"ausschalten|ausschliessen|draussen|draussen lassen|ignorieren|in ruhe(?: lassen)?|off|out|"
    r"out of (?:it|the (?:fusion|game))|raus|raus(?:lassen|nehmen)|weg|weglassen)"
)
_MAY_REST = (
    r"(?:(?:can|may|must|shall|should) (?:be left out|be skipped|rest|stay out)|stays? out|"
    r"bleib(?:en|t) (?:draussen|weg)|(?:darf|duerfen|koennen|soll(?:en)?) (?:draussen bleiben|"
    r"pausieren|ruhen))"
)
_DROPS = r"(?:bench|disregard|drop|exclude|ignore|ignoriert?|leave out|schliesst|skip)"
_ASKS = r"(?:ask|fragt?|nehmt|nutzt|query|take|use|verwendet)"
_ASKED = (
    r"(?:(?:is to be|may be|must be|shall be|should be|to be) (?:asked|used)|(?:darf|soll) "
    r"gefragt werden|fragen|nehmen|nutzen|verwenden)"
)
_ALL_BUT = (
    rf"(?:{_PUTS} )?{_ALL} {_OUT} (?:{_BUT}|{_JUST_NOT})|{_DROPS} {_ALL} (?:{_BUT}|{_JUST_NOT})|"
    rf"(?:{_PUTS} )?{_ALL} {_BUT} {_OUT}|{_ALL} {_BUT} {_MAY_REST}|"
    rf"{_ASKS} {_NOBODY} (?:{_BUT}|{_JUST})|(?:do not|dont) {_ASKS} {_ANYBODY} {_BUT}|"
    rf"{_NOBODY} {_ASKED} (?:{_BUT}|{_JUST})|(?:kein(?:en)? roboter|no robots?) {_BUT}"
)
_FORBIDS = rf"(?:do not|dont) {_ASKS} {_ANYBODY}"
_BUT_FIRST = (
    rf"{_BUT}(?: ,)? (?:please )?(?:{_PUTS} {_ALL} {_OUT}|{_DROPS} {_ALL}|{_FORBIDS}|"
    rf"{_ASKS} {_NOBODY}|{_ALL} (?:raus|weglassen))|"
    rf"(?:{_ASKS} )?none of (?:our|the) (?:robots|units) {_BUT}|"
    rf"(?:{_ASKS} )?kein\w* (?:(?:der|unserer|von den) )?(?:robotern?|roboter) {_BUT}(?: fragen)?|"
    rf"{_ALL} (?:of (?:our|the) robots )?{_BUT} (?:are|is|must|should)(?: to)? be (?:excluded|"
    r"left out|skipped)"
)
_BRAUCHEN = r"(?:brauche ich|brauchen wir|ich brauche|wir brauchen)"
_ENOUGH = (
    rf"(?:(?:i|we) need )?(?:no|not|nothing) more than {_ROBOT}|"
    rf"(?:i|we) (?:do not|dont) need more than {_ROBOT}|"
    rf"mehr als {_ROBOT} (?:(?:{_BRAUCHEN} |muss )?nicht(?: fragen| sein)?)|"
    rf"{_ROBOT} (?:are|is) all (?:i|we) need|{_ROBOT} ist alles ,? ?was (?:ich brauche|"
    rf"wir brauchen)|{_ROBOT} should be the only ones?|{_ROBOT} (?:are|is) the only ones? "
    rf"(?:(?:i|we) need|to (?:ask|use))|{_ROBOT} soll (?:der|die) einzige sein|{_ROBOT} will do|"
    rf"make do with {_ROBOT}|"
    rf"(?:kommt mit {_ROBOT}|mit {_ROBOT} kommt ihr)(?: allein)? aus|mit {_ROBOT} auskommen|"
    rf"begnuegt euch mit {_ROBOT}|belasst es bei {_ROBOT}"
)
_LETS = (
    r"(?:keep|leave) ROBOT charging|(?:leave ROBOT to|let ROBOT) (?:charge|cool (?:down|off)|rest)|"
    rf"lass(?:t|en)? {_ROBOT}(?: erst mal| in ruhe)? (?:abkuehlen|ausruhen|laden)"
)
_SHUNS = (
    r"(?:do not|dont) (?:count on|listen to|rely on|send anything to|trust|wait for) ROBOT|"
    r"take ROBOT offline|block ROBOT|shut (?:down ROBOT|ROBOT down)|"
    rf"vergesst {_ROBOT}|schaltet {_ROBOT}(?: bitte)? (?:ab|aus)|schliesst {_ROBOT}(?: bitte)? aus|"
    rf"{_ROBOT} nicht vertrauen|(?:hoert|verlasst euch|wartet) nicht auf {_ROBOT}|auf {_ROBOT} "
    rf"koennt ihr nicht zaehlen|ich will {_ROBOT} nicht dabeihaben"
)
_DROP_IT = (
    r"(?:(?:drop|exclude|ignore|leave out|skip) ROBOT|leave ROBOT (?:alone|out)|do without ROBOT)"
)
_DROPPING = (
    r"(?:(?:dropping|excluding|ignoring|skipping) ROBOT|leaving (?:out ROBOT|ROBOT (?:alone|out)))"
)
_ONLY_OUT = (
    rf"(?:bloss|just|nur|only) {_ROBOT} (?:auslassen|rauslassen|weglassen|"
    r"(?:is to|must|should) be (?:excluded|left out|skipped)|soll weggelassen werden)|"
    r"(?:leave out|exclude|skip) (?:just|only) ROBOT|leave (?:just|only) ROBOT out|"
    rf"{_BUT}(?: ,)? (?:{_ASKS} {_ALL}|{_ALL} fragen|duerfen alle)|"
    rf"{_NOBODY} (?:auslassen|rauslassen|weglassen) {_BUT}|"
    rf"(?:do not|dont) leave {_ANYBODY} out {_BUT}"
)
_WEG = rf"{_ROBOT}(?: bitte)? (?:auslassen|in ruhe lassen|raus(?:lassen|nehmen)|weglassen)"
_WEGZU = rf"{_ROBOT} (?:auszulassen|in ruhe zu lassen|raus(?:zulassen|zunehmen)|wegzulassen)"
_WEGT = rf"{_ROBOT} (?:auslasst|in ruhe lasst|raus(?:lasst|nehmt)|weglasst)"
_MAY_WE = rf"(?:can|could|may) we(?: please)? {_DROP_IT}|(?:koennen|koennten) wir(?: bitte)? {_WEG}"
_POLITE = (
    rf"would you mind {_DROPPING}|"
    rf"(?:make sure|see to it that) (?:no one|nobody) (?:asks|uses) ROBOT|"
    rf"(?:darf ich euch bitten|wuerde es euch (?:et)?was ausmachen) ,? ?{_WEGZU}|"
    rf"ich moechte ,? ?dass ihr {_WEGT}|"
    rf"es waere (?:gut|nett|schoen) ,? ?(?:{_WEGZU}|wenn ihr {_WEGT})|"
    rf"(?:achtet darauf|sorgt dafuer|stellt sicher) ,? ?dass (?:{_ROBOT} nicht gefragt wird|"
    rf"niemand {_ROBOT} fragt)"
)
_BEFORE = r"(?:(?:and|bitte|jetzt|now|ok|okay|please|so|well)(?: ,)? )*"
_BEHIND = r"(?:(?: ,)? (?:bitte|danke|for now|jetzt|now|please|thanks))*"
_WHOLE: tuple[tuple[Role, re.Pattern[str]], ...] = (
    ("only", re.compile(rf"{_BEFORE}(?:{_ALL_BUT}|{_BUT_FIRST}|{_ENOUGH}){_BEHIND}(?: [.!])*")),
    ("out", re.compile(rf"{_BEFORE}(?:{_LETS}|{_ONLY_OUT}|{_SHUNS}){_BEHIND}(?: [.!])*")),
    ("out", re.compile(rf"{_BEFORE}(?:{_POLITE}){_BEHIND}(?: [.!?])*")),
)
_MAY = re.compile(rf"{_BEFORE}(?:{_MAY_WE}){_BEHIND}(?: [.!?])*")
"""Is a wish where it begs, or says for how long; else it may ask what is possible."""
_BEGS = re.compile(r"\b(?:bitte|please)\b")
_EITHER = {"or", "oder"}
"""In a list of robots they leave open who is meant."""
_TIMES = re.compile(r"(?: ,)? TIME\b(?: ,)?|^TIME(?: ,)? ")


def read_whole(text: Text) -> Reading | None:
    """The reading of such a wish; None where it is another one. Settle it as any other."""
    said = _TIMES.sub("", text.capitals())
    meant = next((role for role, pattern in _WHOLE if pattern.fullmatch(said)), None)
    named = {w.text for m in text.mentions for w in text.words[m.first : m.last]}
    timed = sum(m.kind == "time" for m in text.mentions)
    if (timed or _BEGS.search(said)) and _MAY.fullmatch(said):
        meant = "out"
    if meant is None or timed > 1 or not named.isdisjoint(_EITHER):
        return None
    roles = tuple[Role, ...](
        meant if m.kind == "robot" else "when" if m.when is not None and m.when.clear else "doubt"
        for m in text.mentions
    )
    return Reading(roles, "part" if "doubt" in roles else "all", final=True)
