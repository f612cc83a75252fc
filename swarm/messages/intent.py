"""What a person wants of the swarm, as an intent of fixed form, and the names that a site has.

An intent holds hard wishes, which every decision obeys, and soft ones, which weigh.
Absent wishes are None or empty.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Literal

import msgspec

from swarm.errors import MessageError
from swarm.messages.base import RobotId
from swarm.messages.choices import PolicyName, QMin
from swarm.messages.llm import NonNegative

MAX_NAMES = 256
MAX_WISH_CHARS = 2_000
"""Longer wishes are not read: nobody checks such a read-back."""

_UNSEEN = r"\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069"
"""Controls, also of terminals and of the direction of writing."""
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=64, pattern=rf"^[^{_UNSEEN}]+(?!\n)$")]
"""Of a place or a class, in any alphabet."""
Weight = Literal["low", "high"]
Resource = Literal["bandwidth", "compute"]
LinkShare = Annotated[float, msgspec.Meta(gt=0, le=1)]
Words = Annotated[str, msgspec.Meta(max_length=MAX_WISH_CHARS)]
Time = Annotated[str, msgspec.Meta(max_length=64)]
OtherWords = Annotated[
    dict[Name, Annotated[tuple[Name, ...], msgspec.Meta(max_length=16)]],
    msgspec.Meta(max_length=MAX_NAMES),
]
"""By a place's name, what people call it besides."""
Robots = Annotated[tuple[RobotId, ...], msgspec.Meta(max_length=MAX_NAMES)]


class Focus(msgspec.Struct, frozen=True):
    """How much what lies in a place counts."""

    place: Name
    weight: Weight = "high"


class Intent(msgspec.Struct, frozen=True, kw_only=True):
    """What is wished. Raises ValueError for a time without a zone and an end before the start."""

    exclude: Robots = ()
    """Hard: robots that are not asked."""
    prefer: Robots = ()
    """Soft: robots that are asked where others would be as good."""
    only: Robots | None = None
    """Hard: nobody else is asked; empty: nobody at all."""
    focus: Annotated[tuple[Focus, ...], msgspec.Meta(max_length=MAX_NAMES)] = ()
    """Soft: places whose ground and objects count more, or less."""
    classes: Annotated[dict[Name, Weight], msgspec.Meta(max_length=MAX_NAMES)] = msgspec.field(
        default_factory=dict
    )
    """Soft: classes whose objects count more, or less."""
    q_min: QMin | None = None
    """Hard: quality below which no choice may lie while another one reaches it."""
    link_share: LinkShare | None = None
    """Hard: the part of the link that observations may take."""
    save: Resource | None = None
    """Soft: what is to cost more in the objective."""
    policy: PolicyName | None = None
    """Hard: how is decided."""
    start: Time | None = None
    """ISO 8601 with a time zone; None: at once."""
    until: Time | None = None
    """ISO 8601 with a time zone; None: until it is withdrawn."""
    unclear: Annotated[tuple[Words, ...], msgspec.Meta(max_length=MAX_NAMES)] = ()
    """Words that were not understood, to be asked back."""
    model: Annotated[str, msgspec.Meta(max_length=200)] = ""
    """What understood it; empty: nobody had to."""
    elapsed_ms: NonNegative = 0.0

    def __post_init__(self) -> None:
        start, until = self.starts(), self.ends()
        if start is not None and until is not None and until <= start:
            raise ValueError(f"until {self.until} is not after start {self.start}")

    def starts(self) -> datetime | None:
        """When it comes into force; None: at once."""
        return _time("start", self.start)

    def ends(self) -> datetime | None:
        """When it ends by itself; None: never."""
        return _time("until", self.until)

    def is_hard(self) -> bool:
        """Whether it holds a wish that every decision must obey."""
        wishes = (self.q_min, self.link_share, self.policy, self.only)
        return bool(self.exclude) or any(wish is not None for wish in wishes)

    def is_soft(self) -> bool:
        """Whether it holds a wish that weighs."""
        return bool(self.prefer or self.focus or self.classes or self.save)

    def is_empty(self) -> bool:
        """Whether nothing is wished, whatever was not understood."""
        return not (self.is_hard() or self.is_soft())


class Site(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The names that a wish may use."""

    robots: Robots = ()
    places: Annotated[tuple[Name, ...], msgspec.Meta(max_length=MAX_NAMES)] = ()
    classes: Annotated[tuple[Name, ...], msgspec.Meta(max_length=MAX_NAMES)] = ()
    words: OtherWords = msgspec.field(default_factory=dict)
    """Other words for places; those of names that are none of `places` mean nothing."""


def problems(intent: Intent, site: Site, now: datetime) -> tuple[str, ...]:
    """Why an intent cannot be obeyed on a site, one sentence each; none where it can.

    `now`: with a time zone. A policy's name is the ego's to know.
    """
    found = [
        f"there is no {kind} {name!r}; known: {', '.join(known) or 'none'}"
        for kind, names, known in (
            ("robot", (*intent.exclude, *intent.prefer, *(intent.only or ())), site.robots),
            ("place", tuple(focus.place for focus in intent.focus), site.places),
            ("class", tuple(intent.classes), site.classes),
        )
        for name in dict.fromkeys(names)
        if name not in known
    ]
    found += [
        f"robot {robot!r} is both to be left out and to be asked"
        for robot in dict.fromkeys((*(intent.only or ()), *intent.prefer))
        if robot in intent.exclude
    ]
    if intent.only is not None:
        found += [
            f"robot {robot!r} is preferred, but not among the only ones"
            for robot in intent.prefer
            if robot not in intent.only
        ]
    places = [focus.place for focus in intent.focus]
    found += [
        f"place {place!r} has two weights"
        for place in dict.fromkeys(places)
        if len({focus.weight for focus in intent.focus if focus.place == place}) > 1
    ]
    ends = intent.ends()
    if ends is not None and ends <= now:
        found.append(f"until {intent.until} is over: it is {now.isoformat(timespec='seconds')}")
    return tuple(found)


def intent_to_json(intent: Intent) -> dict[str, Any]:
    """The intent as plain JSON values, every field in its place; numbers as given."""
    plain: dict[str, Any] = msgspec.to_builtins(intent)
    return plain


def intent_from_json(value: Mapping[str, Any] | str | bytes) -> Intent:
    """The intent of a JSON object or its text; absent wishes may be null, empty or left out.

    >>> intent_from_json('{"exclude": ["R3"], "until": null}').exclude
    ('R3',)

    Raises MessageError for an unknown field and a value that is not allowed.
    """
    try:
        plain = msgspec.json.decode(value) if isinstance(value, (str, bytes)) else dict(value)
        if not isinstance(plain, dict):
            raise MessageError(f"an intent is a JSON object, not {type(plain).__name__}")
        if unknown := sorted(set(plain) - set(Intent.__struct_fields__)):
            allowed = ", ".join(Intent.__struct_fields__)
            raise MessageError(f"an intent has no field {unknown[0]!r}; allowed: {allowed}")
        kept = {name: given for name, given in plain.items() if given is not None}
        return msgspec.convert(kept, Intent, strict=True)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"not a valid intent: {error}") from error


def _time(name: str, text: str | None) -> datetime | None:
    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"{name} {text!r} is not a time; allowed: ISO 8601") from error
    if time.tzinfo is None:
        raise ValueError(f"{name} {text!r} has no time zone; allowed: as 2027-01-15T18:00+01:00")
    return time
