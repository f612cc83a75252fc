"""Reads and writes the parts of GGUF, llama.cpp's file format, that training needs.

The format: https://github.com/ggml-org/ggml/blob/master/docs/gguf.md, version 3, little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Tensor = npt.NDArray[Any]
_MAGIC, _VERSION, _ALIGNMENT = b"GGUF", 3, 32
_F32, _F16, _BF16 = 0, 1, 30
_NUMBERS = "BbHhIif?sxQqd"
"""`struct`'s letters by GGUF's numbers of types; s: a text, x: an array."""
_TEXT, _ARRAY, _FLOAT = 8, 9, 6


class _Reader:
    def __init__(self, path: Path) -> None:
        self.data = np.memmap(path, np.uint8, "r")
        self.at = 0

    def number(self, letter: str) -> Any:
        size = struct.calcsize("<" + letter)
        found = struct.unpack("<" + letter, self.data[self.at : self.at + size].tobytes())[0]
        self.at += size
        return found

    def text(self) -> str:
        size = self.number("Q")
        found = self.data[self.at : self.at + size].tobytes().decode(errors="replace")
        self.at += size
        return found

    def value(self, kind: int) -> Any:
        if kind == _TEXT:
            return self.text()
        if kind == _ARRAY:
            inner, count = self.number("I"), self.number("Q")
            return [self.value(inner) for _ in range(count)]
        return self.number(_NUMBERS[kind])


def read(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The facts of a file, and its tensors as float32, rows first.

    Raises ValueError for a file of another format, and for tensors that are quantised.
    """
    reader = _Reader(path)
    magic = reader.data[:4].tobytes()
    reader.at = 4
    version = reader.number("I")
    if magic != _MAGIC or version != _VERSION:
        raise ValueError(f"{path} is no GGUF file of version {_VERSION}")
    tensors, count = reader.number("Q"), reader.number("Q")
    facts: dict[str, Any] = {}
    for _ in range(count):
        name = reader.text()
        facts[name] = reader.value(reader.number("I"))
    places = []
    for _ in range(tensors):
        name = reader.text()
        shape = [reader.number("Q") for _ in range(reader.number("I"))][::-1]
        places.append((name, shape, reader.number("I"), reader.number("Q")))
    base = -(-reader.at // _ALIGNMENT) * _ALIGNMENT
    found = {}
    for name, shape, kind, offset in places:
        found[name] = _numbers(reader.data[base + offset :], kind, shape, name)
    return facts, found


def _numbers(data: Tensor, kind: int, shape: list[int], name: str) -> Tensor:
    count = int(np.prod(shape))
    if kind == _F32:
        return data[: 4 * count].view(np.float32).reshape(shape).copy()
    if kind == _F16:
        return data[: 2 * count].view(np.float16).astype(np.float32).reshape(shape)
    if kind == _BF16:
        halves = data[: 2 * count].view(np.uint16).astype(np.uint32) << 16
        return halves.view(np.float32).reshape(shape)
    raise ValueError(f"the tensor {name} is quantised (type {kind}); read are F32, F16 and BF16")


def write(path: Path, facts: Mapping[str, str | float], tensors: Mapping[str, Tensor]) -> None:
    """Writes texts and float32 numbers, and float16 tensors."""
    head = bytearray(_MAGIC + struct.pack("<IQQ", _VERSION, len(tensors), len(facts)))
    for name, fact in facts.items():
        head += _text(name)
        if isinstance(fact, str):
            head += struct.pack("<I", _TEXT) + _text(fact)
        else:
            head += struct.pack("<If", _FLOAT, fact)
    offset = 0
    for name, tensor in tensors.items():
        head += _text(name) + struct.pack("<I", tensor.ndim)
        head += struct.pack(f"<{tensor.ndim}Q", *tensor.shape[::-1])
        head += struct.pack("<IQ", _F16, offset)
        offset += _padded(tensor.size * 2)
    with path.open("wb") as file:
        file.write(head.ljust(_padded(len(head)), b"\0"))
        for tensor in tensors.values():
            raw = np.ascontiguousarray(tensor, np.float16).tobytes()
            file.write(raw.ljust(_padded(len(raw)), b"\0"))


def _text(text: str) -> bytes:
    raw = text.encode()
    return struct.pack("<Q", len(raw)) + raw


def _padded(size: int) -> int:
    return -(-size // _ALIGNMENT) * _ALIGNMENT
