"""Which words are cues, and in which of them a slip of the keyboard is forgiven."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues import common, fleet, resources, robots, speech, weights

PATTERNS = tuple(
    pattern
    for module in (common, robots, fleet, weights, resources, speech)
    for pattern in vars(module).values()
    if isinstance(pattern, re.Pattern)
)
"""All cues."""

SPELLING = frozenset(
    """nicht never without except ignore exclude leave alone prefer nobody niemand watch important
    quality qualitaet mindestens wenigstens wichtig ausser zuerst bevorzuge benutzen verwenden
    ignorieren ausschliessen weglassen auslassen hoechstens maximal least shouldnt doesnt matter
    attention unwichtig achte below under unter nichts keinen keiner fallen drop ausschliesslich
    exclusively especially besonders first please reduce sparen avoid should shall""".split()
)
"""Words in which one slip of the keyboard is forgiven, or which one slip makes of another."""

KNOWN = frozenset(
    word for pattern in PATTERNS for word in re.findall(r"[a-z]{3,}", pattern.pattern)
)
"""Words that are cues themselves, or parts of one: never slips of another."""
