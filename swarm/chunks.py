"""Large answers in parts: what travels with queries and with parts, and putting parts together.

Zenoh pushes a message of any size into a link's queue as a whole, and closes the transport when
that takes longer than `wait_before_close`. An answer larger than a part therefore travels as
several replies to one query, each small enough for one Zenoh batch, so that the time counts anew
for each of them and their sender can stop between two. How many parts may be sent is up to the
asker: `swarm.credit`.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

from swarm.errors import MessageError
from swarm.messages import MAX_MESSAGE_BYTES

PART_BYTES = 16_000
"""Four parts and their headers fill a Zenoh batch of 65,535 bytes. At 1 Mbit/s a part takes 0.13 s,
so that ten robots with a part each under way occupy the link for 1.3 s, and a full batch 0.52 s, a
tenth of the 5 s after which a stock router gives a link up. Headers are about 0.5 % of a part."""
MAX_PARTS = 1024
"""Most parts of an answer: what a sender with parts of 8 KiB would need for the largest message."""
MAX_TIMEOUT_S = 3600.0

_VERSION = 1
_ASK = struct.Struct("<BIQH")
_MORE = struct.Struct("<BQH")
_PART = struct.Struct("<BHHI")


@dataclass(frozen=True, slots=True)
class AskParts:
    """Travels with a query whose asker takes parts."""

    token: int
    """The asker's number for this answer, 64 random bits."""
    timeout_s: float
    """How long the asker waits for the whole answer."""
    parts: int
    """How many parts may be sent before the asker asks for more."""

    def pack(self) -> bytes:
        """The bytes of the attachment."""
        timeout_ms = round(min(self.timeout_s, MAX_TIMEOUT_S) * 1e3)
        return _ASK.pack(_VERSION, timeout_ms, self.token, self.parts)


@dataclass(frozen=True, slots=True)
class MoreParts:
    """Travels with a query without payload, which asks for more of an answer under way."""

    token: int
    parts: int
    """How many parts may have been sent in all."""

    def pack(self) -> bytes:
        """The bytes of the attachment."""
        return _MORE.pack(_VERSION, self.token, self.parts)


def read_query(attachment: bytes | None) -> AskParts | MoreParts | None:
    """What travels with a query; None when its asker knows of no parts."""
    if not attachment or attachment[0] != _VERSION:
        return None
    if len(attachment) == _ASK.size:
        _, timeout_ms, token, parts = _ASK.unpack(attachment)
        return AskParts(token, timeout_ms * 1e-3, parts)
    if len(attachment) == _MORE.size:
        _, token, parts = _MORE.unpack(attachment)
        return MoreParts(token, parts)
    return None


def split(data: bytes) -> list[tuple[bytes | None, bytes]]:
    """The replies that carry an answer: (attachment, payload). A small one is one reply without
    attachment.

    Raises MessageError when the answer is larger than a message may be.
    """
    if len(data) <= PART_BYTES:
        return [(None, data)]
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError(f"answer of {len(data)} bytes is larger than {MAX_MESSAGE_BYTES}")
    count = math.ceil(len(data) / PART_BYTES)
    return [
        (
            _PART.pack(_VERSION, index, count, len(data)),
            data[index * PART_BYTES : (index + 1) * PART_BYTES],
        )
        for index in range(count)
    ]


@dataclass(slots=True)
class Assembly:
    """The parts of one answer so far, in whatever order they came."""

    count: int = 0
    """How many parts the answer has; 0 until the first came."""
    total: int = 0
    """How many bytes the answer has."""
    received: int = 0
    """How many of them are here."""
    _parts: dict[int, bytes] = field(default_factory=dict)

    @property
    def parts(self) -> int:
        """How many parts are here."""
        return len(self._parts)

    def add(self, attachment: bytes, payload: bytes) -> bytes | None:
        """Takes one part; returns the whole answer with the last one.

        Never holds more than MAX_MESSAGE_BYTES. Raises MessageError when the part contradicts
        itself, a limit, or the parts before it.
        """
        index, count, total = _read_part(attachment)
        if not self.count:
            self.count, self.total = count, total
        if (count, total) != (self.count, self.total):
            raise MessageError(
                f"part {index} is one of {count} with {total} bytes, the parts before it were of "
                f"{self.count} with {self.total}"
            )
        if index in self._parts:
            raise MessageError(f"part {index} of {count} came twice")
        missing = count - len(self._parts) - 1
        if not payload or self.received + len(payload) + missing > total:
            raise MessageError(
                f"part {index} of {count} has {len(payload)} bytes; {self.received} of {total} "
                f"are here and {missing} more parts must follow"
            )
        self._parts[index] = payload
        self.received += len(payload)
        if missing:
            return None
        if self.received != total:
            raise MessageError(f"{count} parts have {self.received} bytes, not {total}")
        return b"".join(self._parts[i] for i in range(count))

    def __str__(self) -> str:
        """What is here, and what is the first part that is not."""
        first = next((i for i in range(self.count) if i not in self._parts), self.count)
        return (
            f"{len(self._parts)} of {self.count} parts ({self.received} of {self.total} bytes) "
            f"came, the first one missing is {first}"
        )


def _read_part(attachment: bytes) -> tuple[int, int, int]:
    """Index, count and total of a part. Raises MessageError when they cannot be true."""
    if len(attachment) != _PART.size:
        raise MessageError(
            f"the description of a part has {len(attachment)} bytes, not {_PART.size}"
        )
    version, index, count, total = _PART.unpack(attachment)
    if version != _VERSION:
        raise MessageError(f"part of version {version}; known: {_VERSION}")
    if not 2 <= count <= MAX_PARTS or index >= count or not count <= total <= MAX_MESSAGE_BYTES:
        raise MessageError(
            f"part {index} of {count} with {total} bytes in all; allowed: 2 to {MAX_PARTS} parts "
            f"and {MAX_MESSAGE_BYTES} bytes"
        )
    return index, count, total
