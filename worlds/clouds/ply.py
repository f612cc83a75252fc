"""Reads the vertices of PLY files (Stanford polygon format 1.0), ascii or binary."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from swarm.errors import WorldError
from swarm.geometry import Points
from worlds.bounded import read_whole
from worlds.clouds.pcd import MAX_POINTS

MAX_HEADER_BYTES = 65_536
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    """dtype by name; "" is a list, whose length only its rows tell."""


def read_ply(path: Path) -> Points:
    """The vertices of a file as float32 (N, 3), NaN and infinity included.

    Raises WorldError that names the file and what is wrong with it.
    """
    try:
        data = read_whole(Path(path))
    except OSError as error:
        raise WorldError(f"point cloud {path} cannot be read: {error}") from error
    order, elements, body = _header(path, data)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise WorldError(f"point cloud {path} has elements {names}; vertex is needed")
    before, vertices = elements[: names.index("vertex")], elements[names.index("vertex")]
    missing = [name for name in "xyz" if not vertices.properties.get(name)]
    if missing:
        raise WorldError(
            f"point cloud {path} has vertex properties {list(vertices.properties)}; "
            "x, y and z are needed"
        )
    for element in (*before, vertices):
        if "" in element.properties.values():
            raise WorldError(
                f"point cloud {path} has a list in its element {element.name}; "
                "vertices, and what is before them, must have single numbers"
            )
    if not order:
        return _ascii(path, body, sum(element.count for element in before), vertices)
    start = sum(element.count * _layout(element, order).itemsize for element in before)
    layout = _layout(vertices, order)
    if len(body) < start + vertices.count * layout.itemsize:
        raise WorldError(
            f"point cloud {path} announces {vertices.count} vertices of {layout.itemsize} bytes "
            f"after {start} bytes of other elements, holds {len(body)} bytes"
        )
    records = np.frombuffer(body, dtype=layout, count=vertices.count, offset=start)
    with np.errstate(over="ignore"):  # a number beyond float32 becomes infinite
        return np.stack([records[name].astype(np.float32) for name in "xyz"], axis=1)


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], bytes]:
    """The byte order ("" of ascii), the elements, and what follows the header."""
    head, found, body = data[:MAX_HEADER_BYTES].partition(b"end_header")
    lines = head.decode("ascii", errors="replace").splitlines()
    if not found or not lines or lines[0].strip() != "ply":
        raise WorldError(f"point cloud {path} has no PLY header that ends with end_header")
    body = data[len(head) + len(found) :]
    body = body[2 if body.startswith(b"\r\n") else 1 :]
    order, elements = None, []
    try:
        for words in (line.split() for line in lines[1:]):
            match words:
                case ["format", name, _]:
                    order = FORMATS[name]
                case ["element", name, count]:
                    elements.append(_Element(name, int(count)))
                    if not 0 <= int(count) <= MAX_POINTS:
                        raise ValueError(f"{count} of {name}; allowed: 0 to {MAX_POINTS}")
                case ["property", "list", *_, name]:
                    elements[-1].properties[name] = ""
                case ["property", kind, name]:
                    elements[-1].properties[name] = _TYPES[kind]
        if order is None:
            raise ValueError("no format")
    except (IndexError, KeyError, ValueError) as error:
        raise WorldError(f"point cloud {path} has a malformed header: {error}") from error
    return order, elements, body


def _layout(element: _Element, order: str) -> np.dtype[np.void]:
    return np.dtype([(name, order + kind) for name, kind in element.properties.items()])


def _ascii(path: Path, body: bytes, skipped: int, vertices: _Element) -> Points:
    rows = body.splitlines()[skipped : skipped + vertices.count]
    width = len(vertices.properties)
    try:
        with np.errstate(over="ignore"):
            values = np.array(b" ".join(rows).split(), dtype=np.float32)
    except ValueError as error:
        raise WorldError(f"point cloud {path} holds something that is no number: {error}") from None
    if len(values) != vertices.count * width:
        raise WorldError(
            f"point cloud {path} announces {vertices.count} vertices of {width} numbers, "
            f"holds {len(values)} numbers"
        )
    columns = [list(vertices.properties).index(name) for name in "xyz"]
    return np.ascontiguousarray(values.reshape(vertices.count, width)[:, columns])
