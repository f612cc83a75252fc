"""What all messages are made of: the base class, names of algorithms, ranges of numbers."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

SCHEMA_VERSION = 1

MAX_MESSAGE_BYTES = 8 * 1024 * 1024
"""Larger messages are refused unread: ten times a raw 64-ring scan."""

Algorithm = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9-]{0,31}(?!\n)$")]
"""Name of a fusion algorithm; which ones there are is perception's to say."""
ALGORITHMS: tuple[Algorithm, ...] = ("early", "intermediate", "late")
"""The paper's three paradigms, each of which is also the name of an algorithm."""
MIXED: Algorithm = "mixed"
"""In place of an algorithm: participants send different forms."""
Source = Literal["policy", "llm", "cache", "fallback", "hold"]

RobotId = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]
Version = Annotated[int, msgspec.Meta(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
Count = Annotated[int, msgspec.Meta(ge=0)]
Ns = Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)]
"""Until the year 2116; offsets can be added without leaving 64 bits."""
Positive = Annotated[float, msgspec.Meta(gt=0)]
Bounded = Annotated[float, msgspec.Meta(ge=-1e7, le=1e7)]
"""Metres, radians or metres a second of anything on this planet; finite as float32, too."""
Vector6 = tuple[Bounded, Bounded, Bounded, Bounded, Bounded, Bounded]
Vector3 = tuple[Bounded, Bounded, Bounded]
AlgorithmName = Annotated[str, msgspec.Meta(max_length=32)]
Mark = Annotated[str, msgspec.Meta(max_length=400)]
Software = Annotated[str, msgspec.Meta(max_length=64)]
Sizes = Annotated[dict[AlgorithmName, Count], msgspec.Meta(max_length=16)]


class Message(msgspec.Struct, kw_only=True, frozen=True):
    """Base of all messages; `v` is the schema version."""

    v: Version = SCHEMA_VERSION
