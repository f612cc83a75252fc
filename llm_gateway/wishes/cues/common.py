"""Words beside all kinds of cues: no, and what stands for what was named before."""

from __future__ import annotations

import re


def any_of(*patterns: str) -> re.Pattern[str]:
    """Any of the patterns, as whole words."""
    return re.compile(r"\b(?:" + "|".join(patterns) + r")\b")


NOT = any_of(
    "aint", "arent", "auf gar keinen fall", "auf keinen fall", "cannot", "cant", "didnt", "do not",
    "does not", "doesnt", "dont", "garnicht", "hasnt", "havent", "in no case", "isnt", "kein",
    "keine", "keinem", "keinen", "keiner", "keinerlei", "keines", "keinesfalls", "keineswegs",
    "mitnichten", "must ?nt", "nada", "nae", "ned", "nee", "need ?nt", "neednt", "neither", "net",
    "neva", "never", "nich", "nicht", "nichts", "nid", "nie", "niemals", "niemals mehr", "niemands",
    "nimma", "nimmer", "nimmermehr", "nix", "no", "no ones", "nobodys", "noed", "nope", "nor",
    "not", "not at all", "on no account", "on no condition", "shouldnt", "under no circumstances",
    "under no conditions", "unter keinen umstaenden", "weder", "werent", "wont", "wouldnt",
)  # fmt: skip
PRONOUN = any_of(
    "alle drei", "beide", "beiden", "both",
    "(?:den|die) (?:also|bitte|mal|lasst|duerft|sollt|koennt|brauchst|braucht|muesst|"
    r"nicht|nich|ned|net|nid)", "(?:den|die) (?:fragt|gebt|haltet|nehmt|nutzt|setzt|stellt|zieht)",
    "(?:den|die) (?:gar|erst|besser|lieber|ganz|einfach|heute|jetzt)", "(?:den|die|das) lassts?",
    "die drei", "die vier", "die zwei", "die zwoa", "diesen", "em", "her", "him", "ihm", "ihn",
    "it", "lassen sie (?:ihn|den|die|sie)", "lasst? (?:den|die|das|sie)", "that one", "the four",
    "the lot", "the pair", "the pair of them", "the three", "the two", "them", "these",
    "these four", "these three", "they", "this one", "those", "those four", "those three",
    "those two", "von (?:dem|denen|der)",
)  # fmt: skip
BOTH = any_of(
    "both", "pair", "the two", "the lot", "beide", "beiden", "these two", "die zwei", "all of them",
    "all three", "alle drei", "neither", "either of them", "sie alle", "keinen von ihnen",
    "keinen von beiden", "beides", "all four", "alle vier", "the three", "the four", "those two",
    "those three", "those four", "these three", "these four", "neither of them", "die drei",
    "die vier", "die zwoa",
)  # fmt: skip
"""Several that were named one by one."""
