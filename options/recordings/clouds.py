"""Reading `foxglove.PointCloud` from protobuf's wire format (https://protobuf.dev/programming-guides/encoding)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from swarm.errors import WorldError
from swarm.geometry import Points

FLOAT32 = 7
"""`foxglove.PackedElementField.NumericType.FLOAT32`."""
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_STRIDE, _FIELDS, _DATA = 4, 5, 6
_NAME, _OFFSET, _TYPE = 1, 2, 3


def read_points(message: bytes) -> Points:
    """float32 (N, 3) of a cloud with float32 x, y and z, wherever they lie in a point.

    Raises WorldError when it is malformed or lacks one of them.
    """
    try:
        return _points(message)
    except (ValueError, IndexError, TypeError, struct.error) as error:
        raise WorldError(f"a point cloud is malformed: {error}") from error


def _points(message: bytes) -> Points:
    stride, data, offsets = 0, memoryview(b""), {}
    for number, value in _fields(memoryview(message)):
        if number == _STRIDE:
            stride = _whole(value)
        elif number == _DATA:
            data = _part(value)
        elif number == _FIELDS:
            name, offset, kind = _element(_part(value))
            if kind == FLOAT32:
                offsets[name] = offset
    if not data:
        return np.zeros((0, 3), dtype=np.float32)
    lacking = [axis for axis in "xyz" if axis not in offsets]
    if lacking:
        raise ValueError(f"it has no float32 {', '.join(lacking)}")
    if stride <= 0 or len(data) % stride or max(offsets[axis] for axis in "xyz") + 4 > stride:
        raise ValueError(f"{len(data)} bytes are no points of {stride} bytes each")
    layout = np.dtype(
        {
            "names": list("xyz"),
            "formats": ["<f4"] * 3,
            "offsets": [offsets[axis] for axis in "xyz"],
            "itemsize": stride,
        }
    )
    table = np.frombuffer(data, dtype=layout)
    return np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float32, copy=False)


def _element(part: memoryview) -> tuple[str, int, int]:
    name, offset, kind = "", 0, 0
    for number, value in _fields(part):
        if number == _NAME:
            name = bytes(_part(value)).decode()
        elif number == _OFFSET:
            offset = _whole(value)
        elif number == _TYPE:
            kind = _whole(value)
    return name, offset, kind


def _whole(value: int | memoryview) -> int:
    if not isinstance(value, int):
        raise TypeError("a number is missing")
    return value


def _part(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise TypeError("bytes are missing")
    return value


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """(number, value) of every field: an integer, or the bytes of a text, array or message."""
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        kind = tag & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield tag >> 3, value
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        else:
            size = {_FIXED64: 8, _FIXED32: 4}.get(kind, len(message) + 1)
        if at + size > len(message):
            raise ValueError("it ends within a field")
        part = message[at : at + size]
        at += size
        yield tag >> 3, part if kind == _BYTES else int.from_bytes(part, "little")


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at
