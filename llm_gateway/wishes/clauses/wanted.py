"""Tells whether a clause that names a part of quality or of the link wishes something of it.

"80 percent quality" and "keep to half the link" do; "R2 only reaches 40 percent quality", "the
link is half used" and "forget the 50 percent limit" do not: what is no wish by its words is asked
back.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.cues import common, resources
from llm_gateway.wishes.names import lexicon
from llm_gateway.wishes.reading import Role

_AROUND = frozenset(
    """SHARE NET TIME THEN - a about also an and around at auf aus back bei bis bitte bloss circa
    danke das dem den der des die eher ein eine einen einer etwa fi for from fuer hey im in it
    its just link lets mal me mind mindestens more net network nun now nur o of ok okay on only
    onwards or our please q roughly rund share so thanks that the then to ueber um und ungefaehr
    uns unser unserer vom von wi wieder with your zu zum zur +""".split()
)
"""Beside a part they say no more than how much it is."""
_SET = (
    r"auf SHARE|begnueg\w*|beschraenk\w*|(?:bring|cut|get|go|hoch|lower|raise|reduce|run(?:ter)?|"
    r"senk\w*|set|setz\w*|stell\w*)|change|confine|einigen|eintragen|erhoeh\w*|fahrt|hal[dt]\w*|"
    r"hold|keep|koenn\w*|lass\w*|leave|let|make|put|reduzier\w*|reset|sagen wir|say|stick|stay|"
    r"stellt|target|ziel\w*"
)
_NEEDS = (
    r"bitte\w* darum|brau?ch\w*|bruuche|can|could|darf\w*|duerf\w*|enough|enuf|fine|genueg\w*|"
    r"genug|has to|have to|in ordnung|insist\w*|i want|i(?:d)? like|id ask|mag|may|moecht\w*|"
    r"muess\w*|muss|must|need\w*|okay|pflicht|plenty|prefer\w*|reich\w*|satisfied|shall|should|"
    r"soll\w*|suffic\w*|tun ?s|tut es|verlang\w*|want\w*|will do|will|wish|woll\w*|would|"
    r"wuensch\w*|zufrieden|zurecht\w*"
)
_QUALITY = re.compile(
    rf"\b(?:{_SET}|{_NEEDS}|accept\w*|aim|ab SHARE|beneath|besser als|better than|kleiner als|"
    rf"lower than|as the (?:floor|lowest)|drunter|guarantee\w*|"
    r"less than|lowest|mind\w*|minim\w*|no use|NOBODYBUT|north of|or (?:better|dont|else|higher|im|"
    r"more|nothing|over|up)|oder (?:besser|drueber|mehr)|over SHARE|require\w*|settle|"
    r"unterschreiten|untergrenze|weniger als)\b"
)
_TAKE = (
    r"(?:allow|anruehr\w*|ausnutz\w*|begrenz\w*|beleg\w*|claim|nehm\w*|nimm|nutz\w*|occupy|spend|"
    r"take|use|verbrauch\w*|verwend\w*)"
)
_LINK = re.compile(
    rf"\b(?:{_SET}|{_NEEDS}|allowance|allowed|at SHARE or|komm\w* mit|ourselves|sind drin|theirs|"
    rf"below|beyond|bleib\w*|capped|ceiling|euch|fuer (?:die )?"
    r"roboter|for (?:the )?(?:robots|you)|geb\w*|gehoer\w* euch|(?:only )?gets?|gibt|give|gives|"
    r"go over|grenze|kriegt|limit|most|only SHARE|or (?:less|lower)|ours|over SHARE|plenty|"
    r"sanctioned|spar\w*|save|stehen (?:euch|uns)|the NET use|TIME nur|under|unter|usable|yours?|"
    r"youre|"
    rf"zulaessig|bekomm\w*)\b|"
    rf"^(?:(?:and|bitte|ihr|just|lets|mal|now|nur|only|please|so|then|TIME|und|you) )*{_TAKE}\b|"
    rf"\bNET (?:nur )?(?:zu )?SHARE {_TAKE}\b|\bSHARE\b.* {_TAKE}(?: (?:bitte|please|TIME))*$"
)
_TAKEN_BACK = re.compile(
    r"\b(?:cancel\w*|drop(?! (?:below|beneath|down|to|under)\b)|forget(?: about)?|ignore|lift|"
    r"never mind|remove|scrap|undo|vergess\w*|vergiss|verwerf\w*) (?:(?:[a-z]+|NET) ){0,4}SHARE\b|"
    r"\bSHARE\b.*\b(?:are|is|ist|sind) (?:aufgehoben|cancelled|gone|lifted|over|removed)\b|"
    r"\bhebt\b.*\bSHARE\b.* auf$|\bhebt\b.* SHARE auf$|\b(?:have|keep|leave|limit\w*|need|reserve|"
    r"stay)\b.* any ?more\b|\bno more SHARE\b|\b(?:need ?not|need ?nt|no longer|no need|"
    r"nicht mehr)\b(?! (?:als|less|more|than|wie)\b)|\b(?:(?:dont|does ?nt|does not|"
    r"do not) (?:have to|need)|(?:brauch\w* mehr|need more)$|muss\w* nicht|muesst euch nicht|"
    r"braucht nicht|brauch\w* .* nicht mehr)\b|\b(?:cease|hoert? auf|quit|stop)\b|\b(?:dont|do not|"
    r"no longer) (?:insist|limit|need|reserve)\w*\b|\b(?:nicht|not) (?:auf|bloss|just|merely|nur|"
    r"only) (?:(?:die|the) )?SHARE\b|\b(?:dont|do not|nicht) (?:be content|stop|beschraenk\w*|"
    r"limit)\b|\bkeine SHARE\b|\bSHARE\b.* brauch\w*(?: \w+)? nicht$|\bgilt nicht\b|\b(?:nobody|"
    r"no ?one|niemand|keiner) (?:brauch\w*|needs?)\b|\bis(?:nt| not) the limit\b|\bisnt needed\b|"
    r"\bnot needed\b"
)
"""Ends a bound, or says that there need be none."""
_EXCEEDS = re.compile(r"\b(?:exceed\w*|more than|mehr als|ueberschreit\w*)\b")
_NO = re.compile(
    r"\b(?:avoid\w*|before|below|eher|faster|hardly|kaum|keinesfalls|less|niemand\w*|no ?one|"
    r"nobody|nothing|ohne|schneller|stop|tab(?:oo|u)|too much|ungern|unless|without|weniger|wer|"
    r"whoever|zu viel)\b"
)
_REPORTS = re.compile(
    r"\b(?:blocked|blockiert|brach|dead|(?:are|is|ist|sind|was) (?:\w+ )?down to|empty|failed|"
    r"frei$|free again|halb|leer|missing|occupied|offline|tot|unrealis\w+|unmoeglich|impossible|"
    r"used|utili[sz]\w*|is back|half (?:as|free)|halb (?:frei|so)|betraegt|delivers|drags|fell|"
    r"fiel|gefallen|gestiegen|gesunken|rose|stieg|(?:belegt|gone|in use|taken|used|weg)$|(?:fahren|"
    r"get|haben|have|run|schaffen) (?:at |mit |\w+ )?SHARE (?:accuracy|quality|"
    r"qualitaet)(?! at least)|erreicht?|kommt nur|liefert|reach(?:ed|es)?|missed|schafft?|zieht|"
    r"(?:falling|falls|rises|sinks|sinkt|steigt|faellt)\b.* (?:to|auf) SHARE|needs? \w+ (?:robots?|"
    r"roboter))\b"
)
_LEFT = re.compile(
    r"\b(?:are|is|ist|sind) (?:\w+ )?(?:frei|free|left)\b(?! (?:be|bleib\w*|for|fuer|halt\w*|zu)\b)"
)
"""Tells what nobody takes."""
_SEES_TO = re.compile(r"\b(?:make|make sure|see|should|sorgt|soll\w*|must|muss)\b")
_YOU_DO = re.compile(
    r"^(?:and )?(?:ihr|you|youre|you are) (?:\w+ )?(?:belegt|braucht|need|nehmt|nutzt|take up|use|"
    r"using)\b(?! (?:just|only|nur)\b)|^(?:(?:die|our|the|unsere) )?(?:fleet|flotte|robots?|"
    r"roboter|schwarm|swarm) (?:beleg\w*|brauch\w*|eats?|need\w*|nutz\w*|takes? up|uses?)\b"
)
"""Tells what the swarm does."""
_EACH = re.compile(
    r"\b(?:each|every|kein(?:e[nr])?|jede[nrs]?|no|per|pro) (?:robot\w*|roboter|unit|ROBOT)\b|"
    r"\bROBOT kommt mit\b|\bSHARE (?:of )?(?:die|the)? ?(?:robots?|roboter)\b"
)
"""Bounds what one robot takes, not the swarm; or how many are asked."""


def wanted(text: str, role: Role) -> bool:
    """Whether a clause wishes something of the one part that it names, of which its words say that
    it is one of `quality`, of the `link`, or kept `free` of it."""
    linked = role != "quality"
    if _TAKEN_BACK.search(text) or _EACH.search(text):
        return False
    if _EXCEEDS.search(text) and not (common.NOT.search(text) or _NO.search(text)):
        return not linked
    if _LEFT.search(text) and not _SEES_TO.search(text):
        return False
    if linked and _YOU_DO.search(text) and not resources.AT_MOST.search(text):
        return False
    if role == "free" or (linked and resources.AT_MOST.search(text)):
        return True
    if not linked and resources.AT_LEAST.search(text):
        return not _REPORTS.search(text) or bool(common.NOT.search(text))
    around = _AROUND | ({"noch"} if linked else lexicon.QUALITY)
    if {*text.split()} <= around:
        return True
    cue = _LINK if linked else _QUALITY
    return bool(cue.search(text)) and not _REPORTS.search(text)
