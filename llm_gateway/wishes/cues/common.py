"""Words beside all kinds of cues: no, and what stands for what was named before."""

from __future__ import annotations

import re


def any_of(*patterns: str) -> re.Pattern[str]:
    """Any of the patterns, as whole words."""
    return re.compile(r"\b(?:" + "|".join(patterns) + r")\b")


NOT = any_of(
    "weder", "noed", "nid", "aint", "nae", "havent", "hasnt", "hardly", "neva", "niemals mehr",
    "nimmer", "net", "nich", "nee", "nope", "nimma", "keinerlei", "keines", "keinesfalls",
    "auf gar keinen fall", "under no circumstances", "not at all", "in no case",
    "unter keinen umstaenden", "dont", "do not", "doesnt", "does not", "never", "not", "no",
    "cannot", "cant", "must ?nt", "neednt", "shouldnt", "arent", "isnt", "wont", "neither",
    "nicht", "ned", "net", "nie", "niemals", "kein", "keine", "keinen", "keiner", "keinem",
    "keinesfalls", "keineswegs", "nichts", "nix", "auf keinen fall", "didnt", "need ?nt",
)  # fmt: skip
PRONOUN = any_of(
    "em",
    "(?:den|die) (?:also|bitte|mal|lasst|duerft|sollt|koennt|brauchst|braucht|muesst|"
    r"nicht|nich|ned|net|nid)",
    "the pair of them", "lasst? (?:den|die|das|sie)", "lassen sie (?:ihn|den|die|sie)",
    "those two", "those three", "these three", "die zwei", "die zwoa", "die drei", "alle drei",
    "the three", "the lot", "both", "the pair", "the two", "beide", "beiden", "her", "that one",
    "diesen", "it", "them", "him", "they", "ihn", "ihm", "these", "those", "this one",
)  # fmt: skip
BOTH = any_of(
    "both", "pair", "the two", "the lot", "beide", "beiden", "these two", "die zwei",
    "all of them", "all three", "alle drei", "neither", "either of them", "sie alle",
    "keinen von ihnen", "keinen von beiden",
)  # fmt: skip
"""Several that were named one by one."""
