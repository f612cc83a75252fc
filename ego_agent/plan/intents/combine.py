"""What several intents in force wish together: the newer one wins where they contradict."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Generic, TypeVar

from swarm.messages import IntentInForce
from swarm.messages.intent import Resource, Weight

T = TypeVar("T", covariant=True)
V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class Wished(Generic[T]):
    """A value and the intent that it comes from."""

    value: T
    by: IntentInForce


@dataclass(frozen=True, slots=True)
class Standing:
    """All that is wished at one time."""

    intents: tuple[IntentInForce, ...] = ()
    """In force, oldest first."""
    exclude: Mapping[str, IntentInForce] = field(default_factory=dict)
    only: Wished[frozenset[str]] | None = None
    prefer: frozenset[str] = frozenset()
    focus: Mapping[str, Wished[Weight]] = field(default_factory=dict)
    classes: Mapping[str, Wished[Weight]] = field(default_factory=dict)
    q_min: Wished[float] | None = None
    link_share: Wished[float] | None = None
    save: Wished[Resource] | None = None
    policy: Wished[str] | None = None
    overruled: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    """By an intent's number: what of it a newer one contradicts, one sentence each."""


def name_of(intent: IntentInForce) -> str:
    """How people are told of an intent."""
    return f"wish {intent.number} of {intent.operator or 'unknown'}"


def is_in_force(intent: IntentInForce, now_ns: int) -> bool:
    """Whether it has begun and not ended."""
    start = intent.intent.starts()
    return (start is None or start <= _time(now_ns)) and not has_ended(intent, now_ns)


def has_ended(intent: IntentInForce, now_ns: int) -> bool:
    """Whether its time is over."""
    until = intent.intent.ends()
    return until is not None and until <= _time(now_ns)


def standing(intents: Sequence[IntentInForce]) -> Standing:
    """What intents wish together, given oldest first."""
    overruled: dict[int, list[str]] = defaultdict(list)
    exclude: dict[str, IntentInForce] = {}
    prefer: dict[str, IntentInForce] = {}
    focus: dict[str, Wished[Weight]] = {}
    classes: dict[str, Wished[Weight]] = {}
    only: Wished[frozenset[str]] | None = None
    single: dict[str, Wished[object]] = {}

    def loses(older: IntentInForce, what: str, newer: IntentInForce) -> None:
        overruled[older.number].append(f"{what} is overruled by {name_of(newer)}")

    def put(kept: dict[str, Wished[V]], key: str, value: V, by: IntentInForce, what: str) -> None:
        before = kept.get(key)
        if before is not None and before.value != value:
            loses(before.by, what, by)
        kept[key] = Wished(value, by)

    for one in intents:
        wish = one.intent
        for robot in (*(wish.only or ()), *wish.prefer):
            if robot in exclude:
                loses(exclude.pop(robot), f"leaving {robot} out", one)
        if wish.only is not None:
            chosen = frozenset(wish.only)
            if only is not None and only.value != chosen:
                loses(only.by, "asking nobody but " + _listed(only.value), one)
            only = Wished(chosen, one)
        if only is not None and only.by is not one and (late := set(wish.prefer) - only.value):
            loses(only.by, "asking nobody but " + _listed(only.value), one)
            only = Wished(only.value | late, only.by)
        for robot in wish.exclude:
            if robot in prefer:
                loses(prefer.pop(robot), f"preferring {robot}", one)
            if only is not None and robot in only.value and only.by is not one:
                loses(only.by, f"asking {robot}", one)
            exclude[robot] = one
        prefer.update(dict.fromkeys(wish.prefer, one))
        for spot in wish.focus:
            put(focus, spot.place, spot.weight, one, f"the weight of {spot.place}")
        for label, weight in wish.classes.items():
            put(classes, label, weight, one, f"the weight of {label}")
        for name, words in _SINGLE.items():
            value = getattr(wish, name)
            if value is not None:
                put(single, name, value, one, words)
    return Standing(
        intents=tuple(intents),
        exclude=exclude,
        only=only,
        prefer=frozenset(prefer),
        focus=focus,
        classes=classes,
        overruled={number: tuple(said) for number, said in overruled.items()},
        **single,  # type: ignore[arg-type]  # each has the type of its field in Intent
    )


_SINGLE = {
    "q_min": "its Q_min",
    "link_share": "its share of the link",
    "save": "what it saves",
    "policy": "its policy",
}


def _listed(robots: frozenset[str]) -> str:
    return ", ".join(sorted(robots)) or "the ego"


def _time(now_ns: int) -> datetime:
    return datetime.fromtimestamp(now_ns * 1e-9, UTC)
