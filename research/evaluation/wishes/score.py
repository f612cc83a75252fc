"""What is right, wrong, and dangerous about an intent that was understood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.special import betaincinv

from research.training.wishes.cases import Case
from swarm.messages.intent import Intent

HARD = ("exclude", "only", "q_min", "link_share", "policy", "start", "until")
SOFT = ("prefer", "focus", "classes", "save")
_CLOSE = 0.005
"""Of numbers: a third may be 0.33."""


@dataclass(frozen=True, slots=True)
class Score:
    """How one wish was understood."""

    exact: bool
    """Everything as meant, and asked back exactly where something is doubtful."""
    unsafe: bool
    """Something hard otherwise than meant, and nothing asked back."""
    confident: bool
    """Anything otherwise than meant, and nothing asked back."""
    asked: bool
    wrong: tuple[str, ...]
    """Fields that are not as meant."""
    elapsed_ms: float


def score(case: Case, intent: Intent) -> Score:
    """Holds an intent against what the wish means."""
    meant = case.meant
    wrong = tuple(name for name in (*HARD, *SOFT) if not _same(name, intent, meant))
    asked = bool(intent.unclear)
    return Score(
        exact=not wrong and asked == case.doubtful,
        unsafe=not asked and any(name in HARD for name in wrong),
        confident=not asked and (bool(wrong) or case.doubtful),
        asked=asked,
        wrong=wrong,
        elapsed_ms=intent.elapsed_ms,
    )


def _same(name: str, said: Intent, meant: Intent) -> bool:
    match name:
        case "start":
            return said.starts() == meant.starts()
        case "until":
            return said.ends() == meant.ends()
        case "q_min" | "link_share":
            one, other = getattr(said, name), getattr(meant, name)
            if one is None or other is None:
                return one is other
            return bool(abs(one - other) <= _CLOSE)
        case "exclude" | "prefer":
            return set(getattr(said, name)) == set(getattr(meant, name))
        case "only":
            return _set(said.only) == _set(meant.only)
        case "focus":
            return {(f.place, f.weight) for f in said.focus} == {
                (f.place, f.weight) for f in meant.focus
            }
        case _:
            return bool(getattr(said, name) == getattr(meant, name))


def _set(names: Sequence[str] | None) -> frozenset[str] | None:
    return None if names is None else frozenset(names)


def at_most(hits: int, tries: int, confidence: float = 0.95) -> float:
    """The one-sided upper bound of a rate (Clopper and Pearson, 1934): 0 of 300 is at most 0.01."""
    if hits >= tries:
        return 1.0
    return float(betaincinv(hits + 1, tries - hits, confidence))


def summary(cases: Sequence[Case], scores: Sequence[Score]) -> dict[str, float | None]:
    """The figures of a table's row."""
    count = len(scores)
    times = sorted(one.elapsed_ms for one in scores)
    row: dict[str, float | None] = {"wishes": count}
    for language in sorted({case.language for case in cases}):
        row[f"exact_{language}"] = _rate(
            [s.exact for c, s in zip(cases, scores, strict=True) if c.language == language]
        )
    row |= {
        "exact": _rate([s.exact for s in scores]),
        "unsafe": sum(s.unsafe for s in scores),
        "unsafe_at_most": round(at_most(sum(s.unsafe for s in scores), count), 4),
        "wrong_and_confident": _rate([s.confident for s in scores]),
        "asked_back": _rate([s.asked for s in scores]),
        "asked_back_needlessly": _rate(
            [s.asked for c, s in zip(cases, scores, strict=True) if not c.doubtful]
        ),
        "p50_ms": times[count // 2] or None,
        "p95_ms": times[int(0.95 * count)] or None,
    }
    for name in ("exclude", "q_min", "link_share", "until"):
        # Where it is meant and nothing is asked back: how often it is as meant.
        told = [
            name not in s.wrong
            for c, s in zip(cases, scores, strict=True)
            if not s.asked and (c.intent.get(name) is not None)
        ]
        row[f"{name}_exact"] = _rate(told)
    return row


def _rate(hits: Sequence[bool]) -> float | None:
    return round(sum(hits) / len(hits), 4) if hits else None
