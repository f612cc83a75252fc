"""Words around a wish: how politely, for whom and why. None of them makes a clause plainer."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

_WOULD = (r"(?:(?:i|it|that|we|you|he|she|they)d|would|should|waer\w*|wuerd\w*|faend\w*|haett\w*|"
          r"ginge?\w*|taet\w*)")  # fmt: skip
SUBJUNCTIVE = re.compile(rf"\b{_WOULD}\b")
WISHED = re.compile(
    rf"^(?!what|how|who|which|why|was|wie|wer|wann)(?:(?:[a-z]+|TIME) ){{0,4}}{_WOULD}\b(?: "
    rf"[a-z]+){{0,6}} (?:if|wenn|dass)\b(?: TIME)?|"
    r"^(?:[a-z]+ ){0,2}(?:id|we ?d|would) (?:much )?(?:prefer(?: it if)?|rather)(?: that)? "
    r"(?:ye|you|yall)\b|^(?:[a-z]+ ){0,2}(?:ich (?:moechte|wollte) (?:\w+ )?bitten|ich bitte|i ask|"
    r"please see to it)(?: [a-z]+)? (?:dass|that)\b"
)
"""Opens a polite wish, which goes on in the past tense: "I'd be glad if R3 were left out"."""
WHETHER = re.compile(r"^(?:if|wenn|dass|that|ob)\b")
WERE = any_of(
    "asked", "did", "didnt", "had", "ignored", "skipped", "used", "watched", "hatten", "hatte",
    "took", "used to", "was", "went", "were", "worden", "wurde",
    "wurden",
)  # fmt: skip
"""Tells nothing in a polite wish."""
_HUMAN = (
    r"(?:(?:my|our|the|your|mein|meine|unser|unsere|der|die) )?(?:\w+ )?(?:boss|supervisor|"
    r"manager|chef|chefin|foreman|forewoman|lead|leader|director|colleague|colleagues|wife|"
    r"husband|owner|captain|master|doctor|sister|chief|safety|security|insurance|customer|"
    r"client|meister|meisterin|kollege|kollegin|kollegen|leitung|schichtleiter|"
    r"schichtleitung|vorarbeiter|betriebsrat|kunde|frau|mann|arzt|oberarzt|auditor|bloke|curator|driver|engineer|guard|guy|inspector|mechanic|nurse|pilot|technician|fahrer|hausmeister|ingenieur|pfleger|schwester|techniker|waerter|sound|ops)"
)
RELAYED = re.compile(
    r"\bthats what (?:[a-z]+ ){1,4}told me(?: to \w+(?: on)?)?|"
    rf"\b{_HUMAN} (?:says?|said|reckons?|tells? me|told me|wants?|demands?|insists?|asks?|asked|"
    r"meint|sagt|sagte|will|moechte|verlangt|wuenscht|besteht darauf)\b"
    r"(?: (?:that|dass|for us to|us to|you to|to pass on))?(?! (?:was|who|which|nothing)\b)|"
    r"\bi(?: would|d)? say\b|\bi say\b|\bas i (?:said|told)(?: to)?(?: (?:the|my|our) \w+)?\b|"
    r"\bi ?(?:ve|have) been told(?: that)?\b|\bi was told(?: that)?\b|\bi hear(?:d)?(?: that)?\b|"
    r"\bword is(?: that)?\b|\bmir wurde gesagt(?: dass)?\b|\bich hab\w* gehoert(?: dass)?\b|"
    r"\bich wuerde sagen\b|\bwie gesagt\b|^(?:\w+ ){1,3}to (?:all|all units|base|fleet|robots|"
    r"swarm)$"
)
"""Tells whose wish it is that the one who speaks passes on: a person's."""
REASONS = {"as", "because", "denn", "since", "weil"}
"""Open a clause that tells why."""
WHY = re.compile(
    r"(?:ansonsten|deren|dessen|otherwise|sonst|whose|(?:bloss|just|nur|only) (?:because|damit|so|"
    r"to|um|weil|zum (?:\w+en|test|vergleich)|(?:as|for|fuer) (?:(?:a|den|einen|the) )?"
    r"(?:\w+ing|comparison|demo|experiment|test|trial|vergleich|versuch)\w*)|(?:(?:das|der|die|"
    r"her|his|ihre?|its|seine?|the) )?(?:akku|batterie|battery|"
    r"camera|getriebe|kamera|lens|lidar|linse|motor|reifen|sensor\w*|tires?|tyres?))\b"
    r"(?! (?:ask|brauch\w*|darf|fragt|keine\w*|muss\w*|nehmt|niemand\w*|nix|no one|nobody|soll\w*|"
    r"take|use|wird)\b)"
)
"""Begins to tell why, or of whom."""
REPORTED = any_of(
    r"^(?:all the|die|our|the) (?:\w+ ){1,2}(?:belegen|eat|fressen|hog|nutzen|occupy|take|use)",
    r"ROBOT (?:\w+ )?(?:bekommt|braucht|gets|has|hat|needs|nutzt|uses)", "eats?", "frisst",
    "fressen", "hogs?", "is using", "occup(?:y|ies)", "takes", "uses",
)  # fmt: skip
"""Tells how much of the link somebody has now."""
GIVEN = any_of(
    "owns?", "gets?", "needs?", "wants?", r"belongs? to", "goes to",
    r"(?:is|are) (?:for|reserved for)", "need", "brauchen", "benoetigen", "braucht", "benoetigt",
    "bekommt", "bekommen", "kriegt", "kriegen", r"gehoer(?:t|en)", r"geh(?:t|en) an", "ist fuer",
    "sind fuer", r"(?:bleib\w*|remains?|stays?) (?:bei|for|fuer|with)",
    r"fuer (?:\w+ ){1,3}bleib\w*", "behaelt", "behalten", "keeps(?= SHARE)",
)  # fmt: skip
OURS = any_of(
    "i", "ihr", "euch", "fleet", "flotte", "it", "lidar", "observations", "perception", "robots?",
    "roboter", "schwarm", "sharing", "swarm", "uns", "us", "we", "wir", "you", "beobachtungen",
)  # fmt: skip
"""With GIVEN: the part is the others', unless the sentence speaks of these."""
USERS = re.compile(
    r"(?:(?:da|der|das|die|our|the|unsere?|weil|denn|because|as) )*[\w-]*(?:alarm\w*|backups?|"
    r"calls?|cameras?|controll?(?:ers?|s)?|erp|funk\w*|kameras?|leitstand|mes|monitor\w*|phones?|plcs?|"
    r"scada|scanner\w*|sps|steuerung\w*|streams?|systeme?n?|systems|telefon\w*|telemetr\w*|traffic|"
    r"video\w*|voip)\b(?: \w+){0,3}? (?:brauch(?:t|en)|comes? first|geh(?:t|en) vor|(?:ha(?:t|ben)|"
    r"ha(?:s|ve)|takes?) (?:precedence|priority|prioritaet|vorfahrt|vorrang)|needs?)\b"
)
"""Tells what else the link or the computers are for."""
LOADED = re.compile(
    r"\bSHARE (?:auslastung|ausgelastet|belegt|busy|full|humidity|load|loaded|luftfeuchte|"
    r"luftfeuchtigkeit|packet loss|loss|paketverlust|usage|used up|utili[sz]\w*|verlust|verluste|"
    r"voll)\b|\b(?:humidity|loss|luftfeuchte|paketverlust\w*|slope|steigung|verlust\w*) "
    r"(?:\w+ ){0,3}SHARE\b|\bCPU (?:\w+ ){0,2}(?:are|is|ist|laeuft|liegt|loads|runs|s|"
    r"sind)(?: \w+){0,3} SHARE\b"
)
"""Tells how loaded something is, or how good the air: no part that a wish bounds."""
STANDS = re.compile(
    r"\bNET (?:is|ist|liegt|laeuft|s|sits|steht) (?:\w+ )?(?:at|auf|bei|zu) SHARE\b"
)
"""Tells how much of the link is taken, or how much may be."""
STATES = re.compile(
    r"\b(?:are|carr(?:y|ies)|com(?:es?|ing)|expect\w*|got|had|has|have|is|its|runs?|s|shows?|"
    r"theres|theyre|theyve|waiting|was|were|weve|fahren|faehrt|haben|hat|hatten?|ist|kommen|"
    r"kommt|laeuft|laufen|sind|steh(?:t|en)|wart(?:et|en)|waren?|wird|werden|zeigt)\b"
)
"""Tells how things are."""
