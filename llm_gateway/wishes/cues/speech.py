"""Words of what is no wish: questions, reports, conditions, and what others say."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

QUESTION = re.compile(
    r"^(?:what(?! (?:matters|counts|is important|worries|bothers|scares|kills|(?:i|we)(?:d| "
    r"would)? (?:\w+ )?(?:want|need|like|ask|lose|fear|fret|care|worry)\w*))|which|(?:who|"
    r"whom)(?! you (?:ask|use|take))|whose|why|how|"
    r"when|where|is|are|am i|does|did|has|have (?:you|we|they|i|any|all|the(?!.*\b(?:choose|"
    r"decide|do|make|pick|run)\b))|should|shall|was|"
    r"were (?:you|they|there|those|these|ROBOT)|do (?:you|we|i|they)|can (?:i|we)(?! (?:have|get|"
    r"please|just|kindly|ask you|ask for|go easy|go light))|can (?:r|ROBOT)|"
    r"could (?:i|we)(?! (?:have|get|please|just|kindly|ask you|ask for|go easy|go light)\b)|must|"
    r"may(?! (?:i|we) (?:have|please|kindly|ask you|ask for)\b)|will (?:ROBOT|the|it)|"
    r"wie|was(?! (?:zaehlt|wichtig|mir|mich|uns)\b)|warum|wer|wen(?! (?:ihr|du|sie) (?:fragt|"
    r"nehmt|nimmst|fragst|fragen|nehmen))|wem|welche[rsnm]?|wo|wann|wieso|weshalb|soll|"
    r"sollen|sollte|ist|sind|wird|hat|haben|darf|muss|gibt|kann (?:ich|man|ROBOT)|"
    r"koennen wir(?! (?:bitte|mal bitte)\b)|bist|weisst)\b"
)
ABLE = re.compile(
    r"(?:reich(?:t|en)|genueg(?:t|en)|geht|ginge|schafft|kommt ihr|would (?:it|ROBOT|SHARE|the)"
    r"(?! be (?:good|great|kind|nice|ok|okay|possible)\b)|wuerde\w* (?:(?:die|der|das) )?(?:es|"
    r"ROBOT|SHARE)|"
    r"(?:can|could) you (?:do|get by|live|make|manage|reach|still|work)|will you (?:make|manage|"
    r"reach)|koenn\w* ihr (?:auch |noch )?(?:auf ROBOT|mit|ohne))\b"
)
"""Of a question: asks what is possible, or enough."""
DOUBTED = re.compile(
    r"\b(?:should (?:i|we)|shall (?:i|we)|soll ich|sollen wir|sollte ich|i wonder|frage mich|maybe|"
    r"perhaps|vielleicht sollte\w*|(?:interessieren|interessiert|wissen|wuesste\w*|wonder|"
    r"wondering|know|curious|gespannt|fragen|frage) (?:\w+ ){0,2}(?:ob|whether|if|wer|who|which|"
    r"wie|how)(?! (?:you|ihr|sie|du|man)\b))\b"
)
"""Asks, wherever it stands."""
CONDITION = re.compile(
    r"\b(?:if|unless|falls|sobald|as soon as|wenn|in case|sofern|when|whenever|once)\b"
)
NO_CONDITION = re.compile(
    r"\b(?:whenever (?:youve|you have|there is|theres) (?:a |the )?choice|"
    r"(?:if|where) (?:(?:you|ye|u|we|they) (?:have|get|got|re given|are given)(?: got)?|there is|"
    r"theres|given) (?:a |an |any |the )?(?:choice|option|selection)|"
    r"if (?:you|we) (?:can choose|may choose|get to (?:choose|pick))|"
    r"(?:falls|sofern|wenn) (?:\w+ ){0,2}(?:die |eine )?(?:wahl|auswahl) (?:besteht|bleibt|habt|"
    r"hast|haben)|(?:falls|sofern|wenn) (?:ihr|du|sie|man) (?:\w+ )?(?:waehlen|aussuchen) "
    r"(?:koennt|kannst|kann|koennen|duerft|darfst)|"
    r"if (?:it makes no difference|you possibly can|youve (?:got )?(?:a|the) choice|"
    r"its no trouble|that works|that helps)|if (?:its|it is|thats) (?:not |no )?(?:all )?(?:too "
    r")?(?:much )?(?:trouble|bother|right|ok|okay|alright|fine)(?: with (?:you|everyone))?|if "
    r"(?:it|that) (?:suits|pleases)(?: you)?|if i may(?: ask)?|wenn ich (?:\w+ ){0,3}(?:bitten|"
    r"wuenschen|frei haben) (?:duerfte|darf|koennte)|wenns (?:recht ist|beliebt|keine umstaende "
    r"macht|nichts ausmacht)|wenn (?:es|das) (?:recht ist|keine umstaende macht|nicht zu viel "
    r"verlangt ist)|if (?:possible|you can|you could|you please|need be|you dont mind|you would|"
    r"at all)|when(?:ever)? you can|(?:would|waere|wuerde) (?:\w+ ){0,3}(?:if|wenn)|wenn "
    r"(?:moeglich|es geht|ihr|du|geht|moeglich|ROBOT mitmach\w*)|"
    r"if you like|when possible)\b"
)
PAST = any_of(
    r"(?:we|they|i|wir) (?:used|asked|left|skipped|ignored|watched|nutzten)", "was",
    r"(?<=[a-zA-Z] )were", "had", "did", "wurde", "wurden", "hatte", "hatten", "used to",
    "has been", "have been", "been", "yesterday", "war", "waren", "gestern", "went", "took",
    "didnt", "wasnt", "worden",
)  # fmt: skip
POLITE = re.compile(
    r"\b(?:i was (?:wondering|hoping)|i wanted to ask|ich wollte (?:fragen|bitten)|"
    r"it would be (?:nice|great|good)|ich waere dankbar|waert ihr so nett)"
    r"(?: (?:if|whether|that|ob|wenn|dass))?\b"
)
"""Opens a wish as if it told or asked something."""
TOLD = re.compile(
    r"\b(?:got|had|broke|fell|failed|lost|hit|crashed|came|started|stopped|gave|made|did|went|ran|"
    r"worked|saw|showed|picked|dropped|stalled|hat|"
    r"haben|hatte|wurde|war|seit|since|kam|fiel|was|were)\b(?! (?:to|zu)\b)"
)
"""Tells what happened, beside a time that is over."""
CORRECTED = re.compile(
    r"\b(?:ach nein|nein doch|no wait|wait no|scratch that|strike that|on second thoughts?|"
    r"actually no|correction|korrektur|quatsch|cancel that|vergesst das|sorry i mean|i meant|"
    r"vergiss (?:das|es) wieder|forget "
    r"(?:that(?! (?:area|bit|corner|one|place|spot)\b)|what i said)|"
    r"ich meinte|doch lieber nicht|kommando zurueck|belay that)\b"
)
"""Takes back what was just said: which half counts has to be asked."""
AGAIN = any_of(
    "again", "back", "wieder", "undo", "cancel", "revert", "zurueck", "return",
)  # fmt: skip
"""Takes back rather than wishes."""
FOREIGN = re.compile(
    r"[\"“”„«»{}<>`|\\]{1}(?!\s*(?:ROBOT|TIME|SHARE))|\b(?:system|assistant|user) ?:|\b(?:"
    r"(?<!i )say(?! (?:by|for|from|half|noon|quarter|till|until)\b| [0-9])|"
    r"says|said(?! again)|sagt|sagte|nachricht|message|reads|(?:hier|da|dort) steht|"
    r"steht :|repeat (?:after|this|the|what|your|everything|all)|translate|"
    r"uebersetz\w*|instructions?|instruktion\w*|prompt|anweisung\w*|you are (?:now|a|an)|du bist|"
    r"ab jetzt bist|pretend|role ?play|maintenance mode|your rules|all rules|deine regeln|"
    r"alle regeln|previous|vorherigen|tell me|erzaehl\w*|joke|witz|json|output|print|admin|root|"
    r"override|jailbreak|stell dir vor|imagine|hypothetically|story|geschichte|poem|gedicht|"
    r"wrote|schrieb|told|asked me|the following|(?<!as )a test|(?<!als )ein test|operators?|"
    r"obeys?|gehorch\w*|hoerst du|hoer auf|claims?|behauptet|announces?|tells|demands?|verlangt|"
    r"quote|zitat|schild|sign)\b"
)
"""Words of a robot, of a text, to a model: nobody's wish."""
HAPPENED = re.compile(
    r"\b(?:bent|broke|came|fell|gave|got|had|hit|hatte|lost|ran|rang|saw|seit|since|went|"
    r"(?!(?:allowed|asked|finished|based|counted|focused|needed|preferred|required|supposed|used|"
    r"wanted|weighted)\b)[a-z]{3,}ed)\b|\b(?:hat|ist|wurde) .*(?:ge|ver|be|zer)[a-z]{2,}(?:en|t)$"
)
"""Tells what happened at a time that it names."""
