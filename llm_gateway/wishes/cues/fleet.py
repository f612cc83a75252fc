"""Words by which a wish speaks of all the other robots, of all, or of none."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

OTHERS = any_of(
    r"(?:everybody|everyone|anybody|anyone|nobody|no ?one) else", "(?:the )?remainder",
    "no other (?:robot|bot|unit)s?", r"sonst (?:bitte )?(?:keine[rn]?|niemand\w*)",
    r"(?:every|any) ?(?:one|body|thing|robot) else",
    r"(?:all |alle )?(?:the |die |den |der )?(?:others?|other (?:ones|robots|bots)|"
    r"remaining(?: ones| robots)?|anderen|uebrigen|restlichen)(?: robots?| robotern?| ones)?",
    r"(?:the|den|der|dem) rest", r"^(?:(?:and|dann|then|und) )*rest", "alle andern",
    "(?<! )rest(?= as| if| when| only)", "(?<=need )(?:any )?more(?: than (?:that|"
    "those))?(?: then)?$",
    "(?<=brauchen )(?:wir )?(?:dann )?mehr nicht$", "^mehr(?= (?:brauch|nehm|frag))",
)  # fmt: skip
"""All robots but those that are named beside them."""
REST = re.compile(
    r"(?:(?:then|and|dann|und|erst|only|nur|danach|after that|afterwards|later|"
    r"hinterher|anschliessend|nachher|spaeter) )*"
    r"(?:(?:(?:all|alle) )?(?:the |der |die |den )?(?:rest|others|anderen|uebrigen)|"
    r"every(?:body|one) else)\b"
)
"""Begins to speak of the others."""
BACKUP = any_of(
    "after that", "afterwards", "as a spare", "as needed", "as required", "assist", "back ?ups?",
    "bei bedarf", "danach", "einspringen", "ersatz", "erst danach", "erst dann", "fallback",
    "fill in", "fine as", "helfen aus", "hinten an", "hintenan", "if necessary", "if need be",
    "if needed", "im notfall", "in an emergency", "in reserve", "last", "later", "nachher",
    "nachrangig", "next", "notfalls", "nur im notfall", "nur wenn", "only when", "reserve",
    "second", "second choice", "secondary", "spaeter", "springen ein", "when need be",
    "when needed", "zuletzt", "zur not", "zweite wahl",
)  # fmt: skip
"""Said of the others: who is named comes first."""
_ASK = (r"(?:ask|us(?:e|ing)|query|poll|call|contact|tak(?:e|ing)|involve|include|consult|task|"
        r"bother|disturb|pester|ping|trouble|touch)\w*")  # fmt: skip
_FRAG = (r"(?:(?:an|ab|be)?(?:g|ge)?frag|(?:be)?nutz|verwend|einsetz|eingesetzt|genommen|nehm|nimm|"
         r"ruf|geruf|mitmach|anfunk|angefunk|behellig|heranzieh|herangezogen|kontaktier|einbezieh|einbezogen|einplan|"
         r"eingeplant|stoer|gestoer)\w*")  # fmt: skip
_PAST = (r"(?:asked|used|queried|polled|called|contacted|pinged|taken|involved|included|consulted|"
         r"tasked|bothered|disturbed|requested|needed|wanted|touched)")  # fmt: skip
_NONE = (r"(?:(?:no ?one|nobody)s?|none(?: of (?:them|the \w+))?|(?:no|not a|not one)(?: single)?"
         r" (?:robots?|bots?|units?|machines?))")  # fmt: skip
_KEINEN = (r"(?:kein|keine[nrm]?|koan\w*|niemand\w*)(?: (?:einzige[nrm]?|der|von den|von euch|"
r"von ihnen|"
           r"roboter\w*|mehr))*")  # fmt: skip
SUFFICES = any_of(
    "are enough", "genuegen", "genuegts?", "is enough", "its enough", "reichen", "reichts?",
    "suffice", "suffices", "will do",
)  # fmt: skip
NOBODY = any_of(
    r"(?:no|zero) (?:queries|questions|requests?) (?:for|to) (?:all|robots|the robots)",
    r"^(?:please )?(?:no|zero) (?:robots?|bots?|units?)(?: at all| please| TIME)*$",
    r"(?:stop|quit|no) (?:ask|us|query|poll|bother|disturb|p)ing (?:of )?(?:anyone|anybody|"
    r"everyone|everybody|any \w+|"
    r"all)",
    rf"(?:dont|do not|never|mustnt|must not|shouldnt|should not|without)(?: \w+){{0,2}} {_ASK}"
    r"(?: \w+)? any(?: (?:single|of (?:them|the|our|these|those)|robots?|bots?|units?))+",
    rf"(?:dont|do not|never) (?:\w+ )?{_ASK} (?:anyone|anybody)",
    rf"no need to {_ASK} any(?: (?:single|of (?:them|the)|robots?|bots?|units?))*",
    rf"{_ASK} {_NONE}", rf"{_NONE}(?: TIME)?(?: at all)?(?: TIME)? {_PAST}",
    rf"(?:dont|do not|never) (?:\w+ )?{_ASK} (?:a|one) (?:single )?(?:robot|bot|unit|one)",
    rf"{_NONE}(?: at all)?(?: (?:should|shall|may|must|is to|are to|gets?|will))+(?: be)? "
    rf"{_PAST}", rf"{_NONE}(?: i mean {_NONE})? (?:gets?|is|are) {_PAST}",
    r"(?:leave|let) (?:all|every one of)(?: of)?(?: the| our)? (?:robots?|bots|units|them) "
    r"(?:alone|be|in peace|rest|undisturbed)",
    r"lass\w*(?: \w+)? alle(?: \w+)? (?:roboter\w*|robots|bots)(?: \w+)? (?:unbehelligt|in "
    r"ruhe|in frieden|stehen|aus|weg|raus|ruhen)",
    rf"(?:requests?|questions|quer(?:y|ies)) (?:to|from|for) {_NONE}",
    r"no (?:requests?|questions|queries) (?:to|for) any\w*(?: robots?| bots?| of them)?",
    rf"{_NONE} (?:is to|are to|is|are|may|shall|should|must|gets?|to) (?:be )?{_ASK}",
    rf"{_FRAG}(?: (?:auch|bitte|erst|gar|heute|jetzt|mal|mir|ihr|TIME|ueberhaupt))* {_KEINEN}",
    rf"{_KEINEN}(?: \w+){{0,3}} (?:zu )?{_FRAG}",
    r"^(?:bitte )?(?:keinen?|null) (?:einzigen )?(?:robots?|roboter|bots?)(?: bitte| TIME)*$",
)  # fmt: skip
"""No robot at all is to be asked."""
SOMEBODY = any_of(
    "else", "but", "except", "besides", "other than", "apart", "sonst", "ausser", r"ander\w+",
    "bis auf", "als", "more than", "mehr als", "PLACE", "CLASS",
)  # fmt: skip
"""Beside NOBODY they say that somebody is, or that it is said of a place only."""
IDLE = any_of(
    "bleiben stehen", "feierabend", "go home", "haben frei", "hands off", "have to do",
    "hold still", "idle", "join", "join in", "joins", "joins in", "keep out", "keep quiet",
    "(?:keinen|nicht einen|kein) finger", "lift a finger", "nichts", "nothing", "pausieren",
    "quiet", "rest", "ruhig", "schlafen", "schweigen", "silent", "sit out", "sleep", "stand by",
    "stand down", "stay out", "stay put", "stehen", "stehenbleiben", "still", "stumm", "wait",
    "warten",
)  # fmt: skip
"""Said of the others: only who is named is asked."""
