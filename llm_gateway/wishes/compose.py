"""Makes an intent of what a wish names and the roles that this has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal, TypeVar

from llm_gateway.wishes.names.mention import Mention
from llm_gateway.wishes.names.mentions import Text
from llm_gateway.wishes.reading import Reading, Role
from llm_gateway.wishes.times.when import When
from swarm.messages.intent import Focus, Intent

_T = TypeVar("_T")


@dataclass
class _Parts:
    robots: dict[Role, list[str]] = field(default_factory=dict)
    weights: dict[str, dict[str, set[Role]]] = field(
        default_factory=lambda: {"place": {}, "class": {}}
    )
    shares: dict[str, set[float]] = field(default_factory=lambda: {"quality": set(), "link": set()})
    saved: set[Literal["bandwidth", "compute"]] = field(default_factory=set)
    policies: set[str] = field(default_factory=set)
    whens: list[tuple[Mention, When]] = field(default_factory=list)


def compose(text: Text, reading: Reading, now: datetime) -> Intent:
    """The intent of a reading; what contradicts itself is left out, and unclear."""
    parts = _parts(text, reading)
    unclear = list(reading.unclear)
    out, only, first = (parts.robots.get(role, []) for role in ("out", "only", "first"))
    clashing = [name for name in out if name in (*only, *first)]
    clashing += [name for name in parts.robots.get("doubt", []) if name in (*out, *only, *first)]
    clashing += [name for name in first if only and name not in only and name not in clashing]
    if clashing:
        unclear += [f"{name}" for name in clashing]
        out, only, first = (
            [name for name in names if name not in clashing] for names in (out, only, first)
        )
    start, until, times_unclear = _times(text, parts.whens, now)
    unclear += times_unclear
    focus = tuple(Focus(name, weight) for name, weight in _weights(parts, "place", unclear))
    classes = dict(_weights(parts, "class", unclear))
    numbers = {kind: _one(values, kind, unclear) for kind, values in parts.shares.items()}
    if len(parts.saved) > 1:
        unclear.append(" and ".join(sorted(parts.saved)))
    policy = _one(parts.policies, "policy", unclear)
    intent = Intent(
        exclude=tuple(out),
        prefer=tuple(first),
        only=() if reading.nobody else tuple(only) or None,
        focus=focus,
        classes=classes,
        q_min=numbers["quality"],
        link_share=numbers["link"],
        save=next(iter(parts.saved)) if len(parts.saved) == 1 else None,
        policy=policy,
        start=None if start is None else start.isoformat(),
        until=None if until is None else until.isoformat(),
        unclear=tuple(dict.fromkeys(unclear)),
    )
    if intent.is_empty():
        unclear = unclear or [text.whole]
        strange = any(mention.kind == "unknown" for mention in text.mentions)
        kept = intent if strange else Intent()
        return Intent(start=kept.start, until=kept.until, unclear=tuple(dict.fromkeys(unclear)))
    return intent


def _parts(text: Text, reading: Reading) -> _Parts:
    parts = _Parts()
    for mention, role in zip(text.mentions, reading.roles, strict=True):
        match role:
            case "out" | "only" | "first" | "doubt" if mention.kind == "robot":
                held = parts.robots.setdefault(role, [])
                held += [name for name in mention.names if name not in held]
            case "high" | "low":
                for name in mention.names:
                    parts.weights[mention.kind].setdefault(name, set()).add(role)
            case "quality" | "link" | "free" if mention.share is not None:
                value = mention.share.value
                kind = "quality" if role == "quality" else "link"
                parts.shares[kind].add(round(1 - value, 3) if role == "free" else value)
            case "save":
                parts.saved.add("bandwidth" if mention.kind == "network" else "compute")
            case "policy":
                parts.policies.update(mention.names)
            case "when" if mention.when is not None:
                parts.whens.append((mention, mention.when))
    return parts


def _weights(
    parts: _Parts, kind: str, unclear: list[str]
) -> Iterator[tuple[str, Literal["low", "high"]]]:
    for name, roles in parts.weights[kind].items():
        if len(roles) > 1:
            unclear.append(name)
        else:
            yield name, "high" if "high" in roles else "low"


def _one(values: set[_T], kind: str, unclear: list[str]) -> _T | None:
    if len(values) > 1:
        unclear.append(f"{kind} {', '.join(str(value) for value in sorted(values, key=str))}")
    return next(iter(values)) if len(values) == 1 else None


def _times(
    text: Text, whens: Sequence[tuple[Mention, When]], now: datetime
) -> tuple[datetime | None, datetime | None, list[str]]:
    """When the intent starts and ends; the words of times that contradict each other."""
    starts = {when.start for _, when in whens if when.start is not None}
    ends = {when.until for _, when in whens if when.until is not None}
    lengths = {when.lasts for _, when in whens if when.lasts is not None}
    words = [text.said(mention.first, mention.last) for mention, _ in whens]
    if len(starts) > 1 or len(ends) + len(lengths) > 1:
        return None, None, words
    start = next(iter(starts), None)
    until = next(iter(ends), None)
    if lengths:
        until = (start or now) + next(iter(lengths))
    if until is not None and until <= (start or now):
        return None, None, words
    return start, until, []
