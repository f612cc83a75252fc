"""Words around a part by which it bounds nothing: changes, reports, and what nobody can tell.

"A third less" is no bound of a third, and "we already use half of the link" is no wish.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.cues import resources

_NO_BOUND = re.compile(
    r"\b(?:another|by(?: about| another| up to)?|um(?: etwa| rund| weitere)?|weitere) SHARE\b|"
    r"\bSHARE (?:below|better|besser|faster|fewer|higher|hoeher|langsamer|less|lower|mehr|more|"
    r"schneller|schlechter|slower|weniger|worse)\b(?! (?:als|is|ist|than)\b)|\bSHARE (?:NET|"
    r"of the NET) (?:less|mehr|more|weniger)\b|\bSHARE (?:as much|so viel|the usual)\b|"
    r"\bALLBUT SHARE\b|\b(?:or|oder) (?:besser|better|lieber|rather) SHARE\b"
)
"""Tells of a change, not of a bound."""
_SAVED = re.compile(
    r"^(?:lasst|leave) SHARE (?:of the |vom )?NET$|\bSHARE (?:NET|vom NET|"
    r"of the NET) (?:ein)?sparen\b|\b(?:cut|einspar\w*|reduce|reduzier\w*|sav(?:e|ing)|senk\w*|"
    r"spar(?:e|en|t)?)(?: (?:bitte|down|NET|please|the))* SHARE\b"
)
"""Tells how much is to be saved: what is left is all but that."""
_TOO = re.compile(
    r"\b(?:is|are|ist|sind)? ?(?:far )?(?:too|zu) (?:few|hoch|high|little|low|much|niedrig|viel|"
    r"wenig)\b|\b(?:not|nicht) (?:enough|genug)\b|\breich(?:en|t) nicht\b|\bisnt enough\b"
)
_HAPPENS = re.compile(
    r"\b(?:accuracy|genauigkeit|precision|q|qualitaet|quality)(?: has)? (?:hat|hovers|is|ist|liegt|"
    r"reached|shows|was)(?: (?:aktuell|around|at|auf|bei|down to|jetzt|noch|now|nur|"
    r"only))* SHARE\b|\b(?:average|aktuell|currently|durchschnitt\w*|gemessen\w*|laut anzeige|"
    r"measured|report|still) .*\bSHARE\b|\b(?:last|letzte) (?:schicht|shift)\b|\bNET (?:laeuft|"
    r"runs) (?:at|bei|mit) SHARE\b|\b(?:immer noch|zurzeit) SHARE\b|\b(?:anzeige|immer noch|"
    r"nur noch|report|zurzeit)\b.*\b(?:qualitaet|quality)\b.*\bSHARE\b|\b(?:qualitaet|"
    r"quality)\b.*(?:\bnur noch bei SHARE\b|\bSHARE right now\b|\breport SHARE\b)|\b(?:fahren|get|"
    r"haben|have|run|schaffen) (?:\w+ )?SHARE (?:accuracy|quality|qualitaet)\b|\bNET (?:load|usage|"
    r"use)(?: (?:is|is at|at))? SHARE$|\b(?:linkauslastung|netzlast|traffic|"
    r"verkehr) (?:\w+ )?SHARE\b|\b(?:are|is) (?:only )?using SHARE\b|^(?:(?:die )?roboter|"
    r"(?:the )?robots|they|we|wir|video|die) (?:only )?(?:belegt|nutzen|take|takes|use|"
    r"uses) SHARE\b|^die nehmen SHARE\b|\bSHARE\b.* (?:in use|is free|ist frei)$|\b(?:haben|have|"
    r"hat|has) .*SHARE .*\b(?:lost|verloren)$|\b(?:already|bereits|currently|derzeit|momentan|"
    r"right now|schon)\b.*\bSHARE\b|\bSHARE\b.* (?:are|is|ist|sind|werden|"
    r"wird) (?:\w+ )?(?:(?:belegt|busy|down|full|genutzt|taken|used|weg)$|(?:broken|gone|kaputt|"
    r"lost|verloren)\b)|\b(?:dropped|faellt|fallen|fell|fiel|gefallen|gesunken|gone|lost|rose|sank|"
    r"stieg|verloren) (?:\w+ )?SHARE\b|\b(?:has|hat) (?:a |an |eine |ein )?(?:\w+ )?(?:of|"
    r"von) SHARE\b"
)
"""Tells how things are."""
_OURS = re.compile(
    r"\b(?:i|ich|we|wir) (?:brauch\w*|need)(?: \w+)? SHARE\b(?!.*\b(?:for|frei\w*|free|fuer)\b)|"
    r"\b(?:gebt?|gib|give|lasst?|leave|spare) (?:me|mir|us|uns) SHARE\b(?!.*\b(?:for|frei\w*|free|"
    r"fuer)\b)"
)
"""Whoever speaks may be one of the swarm, or one of the others."""
_REFUSED = re.compile(
    r"\b(?:do not|dont|never|nie|niemals)(?: (?:nehmt|nutzt|take|use))? SHARE\b|\b(?:not even|"
    r"nicht einmal|nicht mal) SHARE\b|\bSHARE\b.* (?:darf nicht|duerfen nicht|may not|must not|"
    r"mustnt|shall not|should not) (?:be )?(?:belegt|genommen|genutzt|taken|used|verwendet)\b"
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
