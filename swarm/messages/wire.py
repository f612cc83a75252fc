"""Messages as MessagePack: encoding, and decoding with every check."""

from __future__ import annotations

import math
import threading
from functools import cache
from typing import TypeVar

import msgspec

from swarm.errors import MessageError
from swarm.messages.base import MAX_MESSAGE_BYTES, SCHEMA_VERSION, Message

M = TypeVar("M", bound=Message)
_ENCODER = msgspec.msgpack.Encoder()
_building = threading.Lock()


def encode(message: Message) -> bytes:
    """The MessagePack bytes of a message."""
    return _ENCODER.encode(message)


def decode(data: bytes, kind: type[M]) -> M:
    """A validated message of the given kind.

    >>> from swarm.messages import Refusal
    >>> data = encode(Refusal(robot="R1", request=7, reason="off duty"))
    >>> decode(data, Refusal).reason
    'off duty'

    Raises MessageError for too many bytes, malformed MessagePack, another schema version, a field
    of the wrong type or out of range, and a number that is not finite.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError(
            f"{kind.__name__} of {len(data)} bytes is larger than {MAX_MESSAGE_BYTES}"
        )
    try:
        message: M = _decoder(kind).decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        spoken = _version(data)
        if spoken not in (None, SCHEMA_VERSION):
            raise MessageError(
                f"{kind.__name__} of version {spoken} of the messages, and this program speaks "
                f"version {SCHEMA_VERSION}: install one version of the package on both"
            ) from error
        raise MessageError(f"not a valid {kind.__name__}: {error}") from error
    for name in message.__struct_fields__:
        if not _is_finite(getattr(message, name)):
            raise MessageError(f"{kind.__name__}.{name} is not finite")
    return message


class _Versioned(msgspec.Struct):
    """What every version of a message has."""

    v: int


def _version(data: bytes) -> int | None:
    """The schema version that a message names; None where it names none."""
    try:
        return msgspec.msgpack.decode(data, type=_Versioned).v
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


@cache
def _decoder(kind: type[M]) -> msgspec.msgpack.Decoder[M]:
    # msgspec 0.22 shows what it knows of a type before it knows all: a second thread that decodes
    # the type, or one that holds it, just then reads a null pointer.
    with _building:
        return msgspec.msgpack.Decoder(kind)


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(_is_finite(item) for item in value)
    if isinstance(value, msgspec.Struct):
        return all(_is_finite(getattr(value, name)) for name in value.__struct_fields__)
    return True
