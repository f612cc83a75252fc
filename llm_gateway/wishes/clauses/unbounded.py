"""Words around a part by which it bounds nothing: changes, reports, and what nobody can tell.

"A third less" is no bound of a third, and "we already use half of the link" is no wish.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.wanted import wanted
from llm_gateway.wishes.cues import resources
from llm_gateway.wishes.reading import Role

_NO_BOUND = re.compile(
    r"\b(?:another|by(?: about| another| up to)?|um(?: etwa| rund| weitere)?|weitere) SHARE\b|"
    r"\bSHARE (?:below|better|besser|faster|fewer|higher|hoeher|langsamer|less|lower|mehr|more|"
    r"schneller|schlechter|slower|weniger|worse)\b(?! (?:als|is|ist|than)\b)|\bSHARE (?:NET|"
    r"of the NET) (?:less|mehr|more|weniger)\b|\bSHARE (?:as (?:fast|much)|so (?:schnell|viel)|"
    r"the usual)\b|\bALLBUT SHARE\b|\b(?:or|oder) (?:besser|better|lieber|rather) SHARE\b"
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
_OURS = re.compile(
    r"\b(?:i|ich|we|wir) (?:brauch\w*|need|want(?: to have)?)(?: \w+)? SHARE\b(?!.*\b(?:for|"
    r"frei\w*|free|fuer)\b)|\b(?:gebt?|gib|give|lasst?|leave|spare) (?:me|mir|us|"
    r"uns) SHARE\b(?!.*\b(?:for|frei\w*|free|fuer)\b)"
)
"""Whoever speaks may be one of the swarm, or one of the others."""
_REFUSED = re.compile(
    r"\b(?:do not|dont|never|nie|niemals)(?: (?:nehmt|nutzt|take|use))? SHARE\b|\b(?:not even|"
    r"nicht einmal|nicht mal) SHARE\b|\bSHARE\b.* (?:darf nicht|duerfen nicht|duerft ihr nicht|"
    r"may not|must not|mustnt|shall not|should not) (?:be )?(?:belegt|genommen|genutzt|taken|used|"
    r"verwendet)\b"
)
_HALF = 0.5


def unbounded(text: str, value: float, role: Role) -> bool:
    """Whether the part of this value that a clause names bounds nothing, or nobody knows what;
    `role`: what its words make of it."""
    if not wanted(text, role):
        return True
    bounded = resources.AT_MOST.search(text) or resources.AT_LEAST.search(text)
    if not bounded and (_TOO.search(text) or _REFUSED.search(text)):
        return True
    # Whether so much is taken, or so much is left, makes no difference for a half.
    split = value != _HALF and (_SAVED.search(text) or _OURS.search(text))
    return bool(_NO_BOUND.search(text) or (role != "quality" and split))
