"""Words around a part by which it bounds nothing: changes, reports, and what nobody can tell.

"A third less" is no bound of a third, and "we already use half of the link" is no wish.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.cues import resources

_NO_BOUND = re.compile(
    r"\b(?:another|by(?: about| another| up to)?|um(?: etwa| rund| weitere)?|weitere) SHARE\b|"
    r"\bSHARE (?:below|better|besser|faster|fewer|higher|hoeher|langsamer|less|lower|mehr|"
    r"more|schneller|schlechter|slower|weniger|worse)\b(?! (?:als|is|ist|than)\b)|"
    r"\bSHARE (?:NET|of the NET) (?:less|mehr|more|weniger)\b|"
    r"\bSHARE (?:as much|so viel|the usual)\b|\bALLBUT SHARE\b|\b(?:or|oder) (?:besser|better|"
    r"lieber|rather) SHARE\b"
)
"""Tells of a change, not of a bound."""
_SAVED = re.compile(
    r"^(?:lasst|leave) SHARE (?:of the |vom )?NET$|"
    r"\bSHARE (?:NET|vom NET|of the NET) (?:ein)?sparen\b|\b(?:cut|einspar\w*|reduce|reduzier\w*|"
    r"sav(?:e|ing)|senk\w*|spar(?:e|en|t)?)(?: (?:bitte|"
    r"down|NET|please|the))* SHARE\b"
)
"""Tells how much is to be saved: what is left is all but that."""
_TOO = re.compile(
    r"\b(?:is|are|ist|sind)? ?(?:far )?(?:too|zu) (?:few|hoch|high|little|low|much|niedrig|viel|"
    r"wenig)\b|\b(?:not|nicht) (?:enough|genug)\b|\breich(?:en|t) nicht\b|\bisnt enough\b"
)
_HAPPENS = re.compile(
    r"\b(?:accuracy|genauigkeit|precision|q|qualitaet|quality)(?: has)? (?:hat|hovers|is|ist|liegt|"
    r"reached|shows|was)(?: (?:aktuell|around|at|auf|bei|down to|jetzt|noch|now|nur|only))* "
    r"SHARE\b|"
    r"\b(?:average|aktuell|currently|durchschnitt\w*|gemessen\w*|laut anzeige|measured|report|"
    r"still) "
    r".*\bSHARE\b|\b(?:last|letzte) (?:schicht|shift)\b|"
    r"\bNET (?:laeuft|runs) (?:at|bei|mit) SHARE\b|\b(?:immer noch|zurzeit) SHARE\b|"
    r"\b(?:anzeige|immer noch|nur noch|report|zurzeit)\b.*\b(?:qualitaet|quality)\b.*\bSHARE\b|"
    r"\b(?:qualitaet|quality)\b.*(?:\bnur noch bei SHARE\b|\bSHARE right now\b|\breport SHARE\b)|"
    r"\b(?:fahren|get|haben|have|run|schaffen) (?:\w+ )?SHARE (?:accuracy|quality|qualitaet)\b|"
    r"\bNET (?:load|usage|use)(?: (?:is|is at|at))? SHARE$|\b(?:linkauslastung|netzlast|traffic|"
    r"verkehr) (?:\w+ )?SHARE\b|"
    r"\b(?:are|is) (?:only )?using SHARE\b|^(?:(?:die )?roboter|(?:the )?robots|they|we|wir|video|"
    r"die) "
    r"(?:only )?(?:belegt|nutzen|take|takes|use|uses) SHARE\b|^die nehmen SHARE\b|\bSHARE\b.* "
    r"(?:in use|is free|ist frei)$|"
    r"\b(?:haben|have|hat|has) .*SHARE .*\b(?:lost|verloren)$|"
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


def unbounded(text: str, value: float, *, linked: bool) -> bool:
    """Whether the part of this value that a clause names bounds nothing, or nobody knows what;
    `linked`: of the link."""
    bounded = resources.AT_MOST.search(text) or resources.AT_LEAST.search(text)
    if not bounded and (_TOO.search(text) or _HAPPENS.search(text) or _REFUSED.search(text)):
        return True
    # Whether so much is taken, or so much is left, makes no difference for a half.
    split = value != _HALF and (_SAVED.search(text) or _OURS.search(text))
    return bool(_NO_BOUND.search(text) or (linked and split))
