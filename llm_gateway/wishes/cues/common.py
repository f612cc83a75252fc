"""Words beside all kinds of cues: no, and what stands for what was named before."""

from __future__ import annotations

import re


def any_of(*patterns: str) -> re.Pattern[str]:
    """Any of the patterns, as whole words."""
    return re.compile(r"\b(?:" + "|".join(patterns) + r")\b")


NOT = any_of(
    "nor", "werent", "wouldnt", "nobodys", "no ones", "niemands", "on no account",
    "on no condition", "under no conditions", "mitnichten", "nimmermehr", "garnicht", "nada",
    "weder", "noed", "nid", "aint", "nae", "havent", "hasnt", "neva", "niemals mehr", "nimmer",
    "net", "nich", "nee", "nope", "nimma", "keinerlei", "keines", "keinesfalls",
    "auf gar keinen fall", "under no circumstances", "not at all", "in no case",
    "unter keinen umstaenden", "dont", "do not", "doesnt", "does not", "never", "not", "no",
    "cannot", "cant", "must ?nt", "neednt", "shouldnt", "arent", "isnt", "wont", "neither", "nicht",
    "ned", "nie", "niemals", "kein", "keine", "keinen", "keiner", "keinem", "keineswegs", "nichts",
    "nix", "auf keinen fall", "didnt", "need ?nt",
)  # fmt: skip
PRONOUN = any_of(
    "em", r"(?:den|die) (?:fragt|gebt|haltet|nehmt|nutzt|setzt|stellt|zieht)",
    "(?:den|die|das) lassts?", "(?:den|die) (?:gar|erst|besser|lieber|ganz|einfach|heute|jetzt)",
    "von (?:dem|denen|der)",
    "(?:den|die) (?:also|bitte|mal|lasst|duerft|sollt|koennt|brauchst|braucht|muesst|"
    r"nicht|nich|ned|net|nid)", "the pair of them", "lasst? (?:den|die|das|sie)",
    "lassen sie (?:ihn|den|die|sie)", "those two", "those three", "those four", "these three",
    "these four", "the four", "die vier", "die zwei", "die zwoa", "die drei", "alle drei",
    "the three", "the lot", "both", "the pair", "the two", "beide", "beiden", "her", "that one",
    "diesen", "it", "them", "him", "they", "ihn", "ihm", "these", "those", "this one",
)  # fmt: skip
BOTH = any_of(
    "both", "pair", "the two", "the lot", "beide", "beiden", "these two", "die zwei", "all of them",
    "all three", "alle drei", "neither", "either of them", "sie alle", "keinen von ihnen",
    "keinen von beiden", "beides", "all four", "alle vier", "the three", "the four", "those two",
    "those three", "those four", "these three", "these four", "neither of them", "die drei",
    "die vier", "die zwoa",
)  # fmt: skip
"""Several that were named one by one."""
