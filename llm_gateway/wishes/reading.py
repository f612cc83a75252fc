"""What each thing that a wish names is meant to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from llm_gateway.wishes.names.mention import Kind

Role = Literal[
    "out", "only", "first", "high", "low", "quality", "link", "free", "save", "when", "policy",
    "none", "doubt",
]  # fmt: skip
"""`none`: named, but nothing is wished of it; `doubt`: nobody knows, ask."""
Verdict = Literal["all", "part", "nothing", "nobody"]
"""How much of a wish is in its roles: all of it; not all; it is no wish; all of it, and beside them
that no robot is to be asked."""

ROLES: dict[Kind, tuple[Role, ...]] = {
    "robot": ("out", "only", "first", "none"),
    "place": ("high", "low", "none"),
    "class": ("high", "low", "none"),
    "share": ("quality", "link", "free", "none"),
    "time": ("when", "none"),
    "network": ("save", "none"),
    "compute": ("save", "none"),
    "policy": ("policy", "none"),
    "unknown": ("none",),
}
"""What each kind may be."""
VERDICTS: tuple[Verdict, ...] = ("all", "part", "nothing", "nobody")


@dataclass(frozen=True, slots=True)
class Reading:
    """The roles of a wish's mentions, in their order."""

    roles: tuple[Role, ...]
    verdict: Verdict = "all"
    unclear: tuple[str, ...] = ()
    """Words of the wish that these roles leave out."""
    firm: tuple[str, ...] = ()
    """What of these is asked back whatever a second witness says."""
    suspected: tuple[Role | None, ...] = ()
    """What is likely meant by words that are not plain, where their role is `doubt`: a second
    witness may say the same. Empty: nothing."""
    reasons: frozenset[int] = frozenset()
    """Numbers of mentions that only tell why: nothing need be wished of them."""
    measured: frozenset[int] = frozenset()
    """Words that are numbers of which nothing can be wished."""
    nobody: bool = False
    """Whether no robot at all is to be asked."""
    final: bool = False
    """Whether no second witness is heard: quotations and words to a model; and what leaves nothing
    to understand."""
    likely: tuple[float, ...] = ()
    """How likely who read it finds each role, and last the verdict, where that is known."""
