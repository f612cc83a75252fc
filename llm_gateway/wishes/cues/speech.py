"""Words of what is no wish: questions, reports, conditions, and what others say."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

QUESTION = re.compile(
    r"^(?:what(?! (?:matters|counts|is important|worries|bothers|scares|kills|(?:i|we)(?:d|"
    r" would)? (?:\w+ )?(?:want|need|like|ask|lose|fear|fret|care|worry)\w*))|which|(?:who|"
    r"whom)(?! you (?:ask|use|take))|whose|why|how|when|where|is|are|am i|does|did|has|have (?:you|"
    r"we|they|i|any|all|the(?!.*\b(?:choose|decide|do|make|pick|run)\b))|should|shall|was|"
    r"were (?:you|they|there|those|these|ROBOT)|do (?:you|we|i|they)|can (?:i|we)(?! (?:have|get|"
    r"please|just|kindly|ask you|ask for|go easy|go light))|can (?:r|ROBOT)|could (?:i|"
    r"we)(?! (?:have|get|please|just|kindly|ask you|ask for|go easy|go light)\b)|must|may(?! (?:i|"
    r"we) (?:have|please|kindly|ask you|ask for)\b)|will (?:ROBOT|the|it)|wie|was(?! (?:zaehlt|"
    r"wichtig|mir|mich|uns)\b)|warum|wer|wen(?! (?:ihr|du|sie) (?:fragt|nehmt|nimmst|fragst|fragen|"
    r"nehmen))|wem|welche[rsnm]?|wo|wann|wieso|weshalb|soll|sollen|sollte|ist|sind|wird|hat|haben|"
    r"darf|muss|gibt|kann (?:ich|man|ROBOT)|koennen wir(?! (?:bitte|mal bitte)\b)|bist|weisst)\b"
)
ABLE = re.compile(
    r"(?:reich(?:t|en)|genueg(?:t|en)|geht|ginge|schafft|kommt ihr|would (?:it|ROBOT|SHARE|"
    r"the)(?! be (?:good|great|kind|nice|ok|okay|possible)\b)|wuerde\w* (?:(?:die|der|das) )?(?:es|"
    r"ROBOT|SHARE)|(?:can|could) you (?:do|get by|live|make|manage|reach|still|work)|"
    r"will you (?:make|manage|reach)|koenn\w* ihr (?:auch |noch )?(?:auf ROBOT|mit|ohne))\b"
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
    r"\b(?:whenever (?:youve|you have|there is|theres) (?:a |the )?choice|(?:if|where) (?:(?:you|"
    r"ye|u|we|they) (?:have|get|got|re given|are given)(?: got)?|there is|theres|given) (?:a |an |"
    r"any |the )?(?:choice|option|selection)|if (?:you|we) (?:can choose|may choose|"
    r"get to (?:choose|pick))|(?:falls|sofern|wenn) (?:\w+ ){0,2}(?:die |eine )?(?:wahl|"
    r"auswahl) (?:besteht|bleibt|habt|hast|haben)|(?:falls|sofern|wenn) (?:ihr|du|sie|"
    r"man) (?:\w+ )?(?:waehlen|aussuchen) (?:koennt|kannst|kann|koennen|duerft|darfst)|"
    r"if (?:it makes no difference|you possibly can|youve (?:got )?(?:a|the) choice|its no trouble|"
    r"that works|that helps)|if (?:its|it is|thats) (?:not |"
    r"no )?(?:all )?(?:too )?(?:much )?(?:trouble|bother|right|ok|okay|alright|"
    r"fine)(?: with (?:you|everyone))?|if (?:it|that) (?:suits|pleases)(?: you)?|if i may(?: ask)?|"
    r"wenn ich (?:\w+ ){0,3}(?:bitten|wuenschen|frei haben) (?:duerfte|darf|koennte)|"
    r"wenns (?:recht ist|beliebt|keine umstaende macht|nichts ausmacht)|wenn (?:es|"
    r"das) (?:recht ist|keine umstaende macht|nicht zu viel verlangt ist)|if (?:possible|you can|"
    r"you could|you please|need be|you dont mind|you would|at all)|when(?:ever)? you can|(?:would|"
    r"waere|wuerde) (?:\w+ ){0,3}(?:if|wenn)|wenn (?:moeglich|es geht|ihr|du|geht|moeglich|"
    r"ROBOT mitmach\w*)|if you like|when possible)\b"
)
PAST = any_of(
    r"(?:we|they|i|wir) (?:used|asked|left|skipped|ignored|watched|nutzten)", "was",
    r"(?<=[a-zA-Z] )were", "had", "did", "wurde", "wurden", "hatte", "hatten", "used to",
    "has been", "have been", "been", "yesterday", "war", "waren", "gestern", "went", "took",
    "didnt", "wasnt", "worden",
)  # fmt: skip
POLITE = re.compile(
    r"\b(?:i was (?:wondering|hoping)|i wanted to ask|ich wollte (?:fragen|bitten)|"
    r"it would be (?:nice|great|good)|ich waere dankbar|waert ihr so nett)(?: (?:if|whether|that|"
    r"ob|wenn|dass))?\b"
)
"""Opens a wish as if it told or asked something."""
TOLD = re.compile(
    r"\b(?:got|had|broke|fell|failed|lost|hit|crashed|came|started|stopped|gave|made|did|went|ran|"
    r"worked|saw|showed|picked|dropped|stalled|hat|haben|hatte|wurde|war|seit|since|kam|fiel|was|"
    r"were)\b(?! (?:to|zu)\b)"
)
"""Tells what happened, beside a time that is over."""
CORRECTED = re.compile(
    r"\b(?:ach nein|nein doch|no wait|wait no|scratch that|strike that|on second thoughts?|"
    r"actually no|correction|korrektur|quatsch|cancel that|vergesst das|sorry i mean|i meant|"
    r"vergiss (?:das|es) wieder|forget (?:that(?! (?:area|bit|corner|one|place|spot)\b)|"
    r"what i said)|ich meinte|doch lieber nicht|kommando zurueck|belay that)\b"
)
"""Takes back what was just said: which half counts has to be asked."""
AGAIN = any_of(
    "again", "back", "wieder", "undo", "cancel", "revert", "zurueck", "return",
)  # fmt: skip
"""Takes back rather than wishes."""
FOREIGN = re.compile(
    r"[\"“”„«»{}<>`|\\]{1}(?!\s*(?:ROBOT|TIME|SHARE))|\b(?:system|assistant|user) ?:|"
    r"\b(?:(?<!i )say(?! (?:by|for|from|half|noon|quarter|till|until)\b| [0-9])|says|"
    r"said(?! again)|sagt|sagte|nachricht|message|reads|(?:hier|da|dort) steht|steht :|"
    r"repeat (?:after|this|the|what|your|everything|all)|translate|uebersetz\w*|instructions?|"
    r"instruktion\w*|prompt|anweisung\w*|you are (?:now|a|an)|du bist|ab jetzt bist|pretend|"
    r"role ?play|maintenance mode|your rules|all rules|deine regeln|alle regeln|previous|"
    r"vorherigen|tell me|erzaehl\w*|joke|witz|json|output|print|admin|root|override|jailbreak|"
    r"stell dir vor|imagine|hypothetically|story|geschichte|poem|gedicht|wrote|schrieb|told|"
    r"asked me|the following|(?<!as )a test|(?<!als )ein test|operators?|obeys?|gehorch\w*|"
    r"hoerst du|hoer auf|claims?|behauptet|announces?|tells|demands?|verlangt|quote|zitat|schild|"
    r"sign)\b"
)
"""Words of a robot, of a text, to a model: nobody's wish."""
HAPPENED = re.compile(
    r"\b(?:bent|broke|came|fell|gave|got|had|hit|hatte|lost|ran|rang|saw|seit|since|went|"
    r"(?!(?:allowed|asked|finished|based|counted|focused|needed|preferred|required|supposed|used|"
    r"wanted|weighted)\b)[a-z]{3,}ed)\b|\b(?:hat|ist|wurde) .*(?:ge|ver|be|zer)[a-z]{2,}(?:en|t)$"
)
"""Tells what happened at a time that it names."""
