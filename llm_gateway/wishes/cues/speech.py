"""Words of what is no wish: questions, reports, conditions, and what others say."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

QUESTION = re.compile(
    r"^(?:what(?! (?:matters|counts|is important|i (?:want|need)))|which|who|whom|whose|why|how|"
    r"when|where|is|are|am i|does|did|has|have (?:you|we|they|i|any|all|the)|should|shall|"
    r"was|"
    r"were (?:you|they|there|those|these|ROBOT)|"
    r"do (?:you|we|i|they)|can (?:i|we)(?! (?:have|get|please|just))|can (?:r|ROBOT)|"
    r"could (?:i|we)|must|may|will (?:ROBOT|the|it)|"
    r"wie|was(?! (?:zaehlt|wichtig))|warum|wer|wen|wem|welche[rsnm]?|wo|wann|wieso|weshalb|soll|"
    r"sollen|sollte|ist|sind|"
    r"wird|hat|haben|darf|muss|gibt|kann (?:ich|man|ROBOT)|koennen wir|bist|weisst)\b"
)
DOUBTED = re.compile(
    r"\b(?:should (?:i|we)|shall (?:i|we)|soll ich|sollen wir|sollte ich|i wonder|frage mich|maybe|"
    r"perhaps|vielleicht sollte\w*)\b"
)
"""Asks, wherever it stands."""
CONDITION = re.compile(
    r"\b(?:if|unless|falls|sobald|as soon as|wenn|in case|sofern|when|whenever|once)\b"
)
NO_CONDITION = re.compile(
    r"\b(?:whenever (?:youve|you have|there is|theres) (?:a |the )?choice|"
    r"if (?:it makes no difference|you possibly can|youve (?:got )?(?:a|the) choice|"
    r"its no trouble|that works|that helps)|"
    r"if (?:possible|"
    r"you can|you could|you please|need be|you dont mind|you would|at all)|"
    r"when(?:ever)? you can|(?:would|waere|wuerde) (?:\w+ ){0,3}(?:if|wenn)|wenn (?:moeglich|"
    r"es geht|ihr|du|geht|moeglich|ROBOT mitmach\w*)|"
    r"if you like|when possible)\b"
)
PAST = any_of(
    r"(?:we|they|i|wir) (?:used|asked|left|skipped|ignored|watched|nutzten)",
    "was", r"(?<=[a-zA-Z] )were", "had", "did", "wurde", "wurden", "hatte", "hatten",
    "used to",
            "has been", "have been", "been", "yesterday", "war", "waren",
            "gestern", "went", "took", "didnt", "wasnt", "worden")  # fmt: skip
POLITE = re.compile(
    r"\b(?:i was (?:wondering|hoping)|i wanted to ask|ich wollte (?:fragen|bitten)|"
    r"it would be (?:nice|great|good)|ich waere dankbar|waert ihr so nett)"
    r"(?: (?:if|whether|that|ob|wenn|dass))?\b"
)
"""Opens a wish as if it told or asked something."""
TOLD = re.compile(
    r"\b(?:got|had|broke|fell|failed|lost|hit|crashed|came|started|stopped|hat|"
    r"haben|hatte|wurde|war|seit|since|kam|fiel|was|were)\b(?! (?:to|zu)\b)"
)
"""Tells what happened, beside a time that is over."""
AGAIN = any_of("again", "back", "wieder", "undo", "cancel",
             "revert", "zurueck", "return")  # fmt: skip
"""Takes back rather than wishes."""
FOREIGN = re.compile(
    r"[\"“”„«»{}<>`|\\]{1}(?!\s*(?:ROBOT|TIME|SHARE))|\b(?:system|assistant|user) ?:|\b(?:"
    r"(?<!i )say|says|said(?! again)|sagt|sagte|nachricht|message|reads|(?:hier|da|dort) steht|"
    r"steht :|repeat (?:after|this|the|what|your|everything|all)|translate|"
    r"uebersetz\w*|instructions?|instruktion\w*|prompt|anweisung\w*|you are (?:now|a|an)|du bist|"
    r"ab jetzt bist|pretend|role ?play|maintenance mode|your rules|all rules|deine regeln|"
    r"alle regeln|"
    r"previous|vorherigen|tell me|erzaehl\w*|joke|witz|json|output|print|admin|root|override|"
    r"jailbreak|"
    r"stell dir vor|imagine|hypothetically|story|geschichte|poem|gedicht|wrote|schrieb|told|"
    r"asked me|"
    r"the following|a test|ein test|operators?|obeys?|gehorch\w*|hoerst du|hoer auf|"
    r"claims?|behauptet|announces?|tells|demands?|verlangt|quote|zitat|schild|sign)\b"
)
"""Words of a robot, of a text, to a model: nobody's wish."""
