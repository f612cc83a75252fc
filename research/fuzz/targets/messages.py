"""Targets: messages between processes, what travels beside them, and keys."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import msgspec
import numpy as np

from research.fuzz.target import Target
from swarm import messages
from swarm.arrays import Array, unpack, unpack_finite
from swarm.chunks import Assembly, read_query
from swarm.errors import KeyspaceError, MessageError
from swarm.keyspace import belongs_to_robot, check_name, robot_of
from swarm.messages import MAX_MESSAGE_BYTES, Message, decode, encode

KINDS: tuple[type[Message], ...] = tuple(
    kind
    for name in sorted(messages.__all__)
    if isinstance(kind := getattr(messages, name), type)
    and issubclass(kind, Message)
    and kind is not Message
)
"""By the first byte of an input."""
_PARTS = struct.Struct("<B")


def _message(data: bytes) -> None:
    """One byte for the kind, the rest is MessagePack."""
    if data:
        _decoded(data[1:], KINDS[data[0] % len(KINDS)])


def _fields(data: bytes) -> None:
    """One byte for the kind, the rest is JSON: an input keeps its form more often than in
    MessagePack, and values change. Text that begins with `b:` becomes bytes, `nan` a number."""
    try:
        values = json.loads(data[1:])
        packed = msgspec.msgpack.encode(_as_told(values))
    except (ValueError, RecursionError, OverflowError):
        return
    _decoded(packed, KINDS[data[0] % len(KINDS)])


def _as_told(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_told(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_as_told(item) for item in value]
    if isinstance(value, str) and value.startswith("b:"):
        return base64.b64decode(value[2:])
    return float(value) if value in ("nan", "inf") else value


def _decoded(data: bytes, kind: type[Message]) -> None:
    message = decode(data, kind)
    again = decode(encode(message), kind)
    assert again == message, f"{message} became {again}"


def _chunks(data: bytes) -> None:
    """Pairs of an attachment and a payload, each with its length in a byte before it."""
    whole, at, parts = Assembly(), 0, []
    while at < len(data):
        (size,) = _PARTS.unpack_from(data, at)
        parts.append(data[at + 1 : at + 1 + size])
        at += 1 + size
    for attachment in parts[::2]:
        read_query(attachment)
    for attachment, payload in zip(parts[::2], parts[1::2], strict=False):
        answer = whole.add(attachment, payload)
        assert whole.received <= MAX_MESSAGE_BYTES
        assert answer is None or len(answer) == whole.total


def _array(data: bytes) -> None:
    """Up to the first zero byte dtype and sizes as text, the rest is the array's bytes."""
    head, _, body = data.partition(b"\0")
    words = head.decode("latin-1").split()
    try:
        shape = tuple(int(word) for word in words[1:])
    except ValueError:
        return
    array = Array(words[0] if words else "", shape, body)
    values = unpack(array)
    assert values.nbytes == len(body)
    finite = unpack_finite(array, "array", 3)
    assert np.isfinite(finite).all()


def _key(data: bytes) -> None:
    key = data.decode("utf-8", errors="replace")
    if belongs_to_robot(key):
        name = robot_of(key)
        assert check_name("robot id", name) == name
        assert f"/{name}/" in key
    else:
        check_name("swarm name", key)


MESSAGES = Target(_message, (MessageError,))
FIELDS = Target(_fields, (MessageError,), json_from=1)
CHUNKS = Target(_chunks, (MessageError,))
ARRAYS = Target(_array, (MessageError,))
KEYS = Target(_key, (KeyspaceError,), max_bytes=256)
