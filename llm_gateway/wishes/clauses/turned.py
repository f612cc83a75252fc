"""Words around cues by which a clause says something else of its robots than they do.

"Leave R1 in" leaves nobody out, "without R1 nothing works" wishes for R1, and "R3 is out of sight"
wishes nothing: such a clause is asked back.
"""

from __future__ import annotations

import re

from llm_gateway.wishes.clauses.negations import negated
from llm_gateway.wishes.cues import robots

_END = r"(?: (?:bitte|please|for now|now|TIME))*$"
_GROUP = (
    r"(?:fleet|fusion|game|group|line ?up|list|loop|mix|picture|play|pool|rotation|roster|running|"
    r"sharing|swarm|team)"
)
_STAYS = re.compile(
    r"\bleav\w* ROBOT (?:\w+ )?(?:(?:active|as (?:he|it|she) is|as is|enabled|in|on|running)"
    rf"{_END}|(?:in|on|within) (?:our |the )?{_GROUP}\b|to (?:do|go on|handle|run|work)\b)|"
    r"\bleav\w* (?:everything|it|that|them|things|this) (?:all )?to ROBOT\b|\b(?:leav\w*|"
    r"let) ROBOT (?:carry|cope|do|drive|go(?! (?:ahead|before|first))|handle|join|manage|run|"
    r"take(?! the lead)|work)\b"
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
    r"no one|nobody|nothing|unmoeglich|useless|verloren|wont)\b.* (?:ohne|without) (?:(?:den|die|"
    r"das|the) )?ROBOT\b"
)
"""Wishes for whom it seems to do without."""
_SELDOM = re.compile(
    r"\b(?:hardly|kaum|rarely|scarcely|seldom|selten)(?: ever| je)? (?:aus|ignored|off|out|skipped|"
    r"weg)\b"
)
_SOME_OF = re.compile(
    r"\b(?:any|either|ein(?:e[mnrs]?)?|half|most|one|some|three|two|drei|welche|"
    r"zwei)(?: out)? (?:of|von|aus)(?: (?:den|the))? ROBOT\b|\bROBOT (?:or|oder)(?: \w+)? ROBOT\b"
)
"""Some of those that are named: nobody knows which."""
_ONWARDS = re.compile(
    r"\bROBOT (?:and|und|or|oder) (?:above|below|beyond|down|higher|lower|up|upwards?|hoeher|"
    r"niedriger|aufwaerts)\b|\bROBOT (?:aufwaerts|onwards?|upwards?)\b|\b(?:ab|from|"
    r"von) ROBOT (?:alle|an|aufwaerts|on|onwards?|up|upwards?)\b|\b(?:all\w*|every\w*|robots?|"
    r"roboter) (?:\w+ )?(?:above|after|below|beyond|bis(?: zu)?|ueber|unter|up to) ROBOT\b"
)
"""Names where a row of robots begins or ends."""
_BRIEFLY = re.compile(
    r"\b(?:ask|fragt?|nehmt?|nimm|nutzt?|take|use)\b.* (?:bloss|just|lediglich|nur|only) TIME\b|"
    r"\bROBOT (?:bloss|lediglich|nur) TIME(?: [a-z]+)?$|\bROBOT (?:can|darf|is|ist|kann|"
    r"may) (?:\w+ )?(?:only|nur)(?: noch)? (?:\w+ )*TIME\b|\b(?:have|"
    r"haben) (?:only )?ROBOT (?:only )?TIME\b|\bROBOT TIME only$|\bROBOT nur noch TIME$"
)
"""Of when, not of whom, it says "only"."""
_OPPOSED = re.compile(
    r"\b(?:ask|fragt?|nutzt?|query|use|verwendet?) (?:\w+ )?ROBOT (?:never|nie|off|out|raus|weg)\b"
)
"""What begins as a list of those who are asked ends with who is out."""
_STILL_IN = re.compile(
    r"(?:(?:but|aber|though|jedoch|however) )*(?:keep ROBOT(?: in| on)?|(?:der |die |"
    r"das )?ROBOT (?:(?:bleibt|remains|stays)(?: \w+)?|(?:is|ist) (?:allowed|back|fine|good|in|ok|"
    r"okay|noch dabei|dabei|wieder da)|can stay|darf bleiben|drin|dabei|in|may stay|not|nicht|"
    r"rein))(?: (?:aber|bitte|however|please|though|TIME|too))*"
)
"""Takes one of those who are left out back in."""
_SOME_TIME = re.compile(
    r"\bROBOT (?:(?:aus|off|out|raus|weg) )?(?:after that|afterwards|bald|danach|kurz|later|"
    r"nachher|soon|spaeter)\b"
)
_PERHAPS = re.compile(r"\b(?:i|ich|it|we|wir) (?:could|koennte\w*|might)\b|\bvielleicht\b")
_ENOUGH = re.compile(
    r"\b(?:mehr als|more than) ROBOT\b.*\b(?:dont|nicht|not?)\b|\b(?:dont|"
    r"not?)\b.* more than ROBOT\b|\bkommt? mit ROBOT(?: \w+)? aus\b|"
    r"\bmit ROBOT kommt? (?:\w+ )?aus\b"
)
"""He is enough."""
_NO_WISH = re.compile(
    r"\b(?:just|nur|only) ROBOT (?:answers|antwortet|are (?:charged|free|here|idle|left)|can see|"
    r"here|hier|is|ist|saw|sees|sind)\b(?! (?:allowed|asked|to)\b)|^ROBOT (?:ha[st] |"
    r"have )?(?:avoided|dropped out|forgot\w*|ignored|ignorierte|skipped|suspended|uebersah)\b|"
    r"^ROBOT hat .*\b(?:ignoriert|uebersehen|vergessen)$|"
    r"\b(?:danke?|gut|thanks?)(?: you)?,?(?: dass| for| that)\b.*\bROBOT\b|\bgood that ROBOT\b|"
    r"\b(?:i|ich|jemand|sie|somebody|someone|they|we|wir) (?:hab\w*|hat|have|has|"
    r"ve) .*\bROBOT\b.*\b(?:abgeschaltet|ausgeschlossen|left|off|out|rausgenommen|skipped|"
    r"weggelassen)$|\bno need (?:for \w+ )?to (?:avoid|drop|exclude|ignore|leave|skip)\b|"
    r"\bleav\w* ROBOT (?:there|where (?:he|it|she) is)\b|\b(?:ohne|"
    r"without) ROBOT (?:is|ist|sind|were|we are) (?:\w+ )?(?:bloed|langsam|slow|schlecht|worse)\b"
)
"""Tells how somebody is, or what he did; or thanks."""
_ELSEWHERE = re.compile(
    r"\bROBOT (?:is|ist) (?:auf dem weg|ausser sicht|off (?:the charger|to|track)|"
    r"on (?:his|its) way|out of (?:sight|the way)|vom weg ab)\b|"
    r"\bROBOT\b.*\b(?:aus dem weg|im weg|off (?:the )?charger|"
    r"out (?:for (?:a (?:drive|ride|run|walk)|deliver\w*)|on (?:a|his|its|patrol)|"
    r"of the (?:charger|hall|way))|von der (?:lade\w*)|(?:checked|came|sorted|tested|turned|"
    r"worked) out|schaut gut aus|weg von)\b|\boff (?:(?:it|you) goe?s?|maintenance)\b|"
    r"\b(?:off(?: - |-| )?time|rest|time ?out) is over\b"
)
"""Tells where somebody is or was, or how he came out."""
_OTHERS_SAY = re.compile(
    r"\b(?:is|ist) (?:forbidden|not allowed|verboten)\b|\blist of (?:excluded|ignored|skipped)\b|"
    r"\bforget about ROBOT being\b|\b(?:keiner|niemand|nobody|no ?one) (?:asks? for|is asking|"
    r"wants?|will) ROBOT (?:be )?(?:out|raus|weg)\b"
)
"""Speaks of leaving somebody out, and says no to it."""
_ONLY_DOES = re.compile(
    r"\b(?:es geht nur um|this is only about) ROBOT\b|^(?:es ist nur|it is only|its only) ROBOT$|"
    r"\b(?:just|nur|only) ROBOT (?!(?:allowed|asked|counts|does|excluded|gets|goes|has|helps|"
    r"ignored|is|matters|needed|needs|plays|skipped|stays|takes|used|was|wanted)\b)"
    r"(?:[a-z]{3,}(?:ed|[^s]s)|geht|kann|kennt|made|weiss)\b|"
    r"\b(?:ALLBUT|NOBODYBUT) ROBOT (?!(?:allowed|asked|included|invited|needed|skipped|used|"
    r"wanted)\b)(?:[a-z]+ed|answers?|are back|antworten|saw|sees|sind wieder)\b"
)
"""Tells what somebody alone, or all but he, did: "only R1 answered"."""


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
        or _NO_WISH.search(text)
        or _ELSEWHERE.search(text)
        or _OTHERS_SAY.search(text)
        or _ONLY_DOES.search(text)
        or _PERHAPS.search(text)
        or (_SOME_TIME.search(text) and "TIME" not in text)
        or _ENOUGH.search(text)
        or (_SOME_OF.search(text) and not negated(text))
    )


def stays(text: str) -> bool:
    """Whether a clause takes a robot back in that another one leaves out."""
    return bool(_STILL_IN.fullmatch(text))
