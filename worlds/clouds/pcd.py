"""Reads the points of PCD files (Point Cloud Library format 0.7): ascii, binary, compressed."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarm.errors import WorldError
from swarm.geometry import Points
from worlds.bounded import read_whole
from worlds.clouds.lzf import decompress

MAX_HEADER_BYTES = 4096
MAX_POINTS = 12_000_000
MAX_COMPRESSED_BYTES = 1 << 28
"""Of the points of a compressed file, unpacked."""
MAX_TEXT_BYTES = 64
"""Of a number in an ascii file, with the space around it."""
_TYPES = {("F", 4): "<f4", ("F", 8): "<f8"} | {
    (kind, size): f"{'<' if size > 1 else '|'}{code}{size}"
    for kind, code in (("I", "i"), ("U", "u"))
    for size in (1, 2, 4, 8)
}


def read_pcd(path: Path) -> Points:
    """The points of a file as float32 (N, 3) in the sensor's frame as stored, NaN and infinity
    included.

    Raises WorldError that names the file and what is wrong with it.
    """
    try:
        data = read_whole(Path(path))
    except OSError as error:
        raise WorldError(f"point cloud {path} cannot be read: {error}") from error
    header, body = _split_header(path, data)
    count = _positive(path, header, "POINTS")
    fields = header.get("FIELDS", [])
    missing = [name for name in ("x", "y", "z") if name not in fields]
    if missing:
        raise WorldError(f"point cloud {path} has fields {fields}; x, y and z are needed")
    kind = header["DATA"][0]
    if kind == "ascii":
        return _read_ascii(path, body, fields, count)
    if kind == "binary":
        return _read_binary(path, body, header, count)
    if kind == "binary_compressed":
        return _read_compressed(path, body, header, count)
    raise WorldError(
        f"point cloud {path} has DATA {kind}; allowed: ascii, binary, binary_compressed"
    )


def _split_header(path: Path, data: bytes) -> tuple[dict[str, list[str]], bytes]:
    header: dict[str, list[str]] = {}
    start = 0
    while start < min(len(data), MAX_HEADER_BYTES):
        end = data.find(b"\n", start)
        if end < 0:
            break
        words = data[start:end].decode("ascii", errors="replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
            if words[0].upper() == "DATA":
                if len(words) != 2:
                    break
                return header, data[start:]
    raise WorldError(f"point cloud {path} has no PCD header that ends with a DATA line")


def _positive(path: Path, header: dict[str, list[str]], name: str) -> int:
    words = header.get(name, [])
    if len(words) != 1 or not words[0].isdigit() or int(words[0]) > MAX_POINTS:
        raise WorldError(
            f"point cloud {path} has {name} {' '.join(words)!r}; it must be 0 to {MAX_POINTS}"
        )
    return int(words[0])


def _read_ascii(path: Path, body: bytes, fields: list[str], count: int) -> Points:
    if len(body) > MAX_TEXT_BYTES * (count * len(fields) + 1):
        raise WorldError(
            f"point cloud {path} announces {count} points of {len(fields)} numbers, holds "
            f"{len(body)} bytes"
        )
    try:
        with np.errstate(over="ignore"):  # a number beyond float32 becomes infinite
            values = np.array(body.split(), dtype=np.float32)
    except ValueError as error:
        raise WorldError(f"point cloud {path} holds something that is no number: {error}") from None
    if len(values) != count * len(fields):
        raise WorldError(
            f"point cloud {path} announces {count} points of {len(fields)} numbers, "
            f"holds {len(values)} numbers"
        )
    return _xyz(values.reshape(count, len(fields)), fields)


def _read_binary(path: Path, body: bytes, header: dict[str, list[str]], count: int) -> Points:
    layout, columns = _layout(path, header)
    if len(body) < count * layout.itemsize:
        raise WorldError(
            f"point cloud {path} announces {count} points of {layout.itemsize} bytes, "
            f"holds {len(body)} bytes"
        )
    records = np.frombuffer(body, dtype=layout, count=count)
    with np.errstate(over="ignore"):
        return np.stack([records[f"{c}"][:, 0].astype(np.float32) for c in columns], axis=1)


def _read_compressed(path: Path, body: bytes, header: dict[str, list[str]], count: int) -> Points:
    """One field after the other, all points of each."""
    layout, columns = _layout(path, header)
    try:
        packed, size = struct.unpack_from("<II", body)
        if size != count * layout.itemsize:
            raise ValueError(f"{size} bytes for {count} points of {layout.itemsize} bytes")
        if size > MAX_COMPRESSED_BYTES:
            raise ValueError(f"it unpacks to {size} bytes; allowed: {MAX_COMPRESSED_BYTES}")
        data = decompress(body[8 : 8 + packed], size)
    except (struct.error, ValueError) as error:
        raise WorldError(f"point cloud {path} is not well compressed: {error}") from error
    read: list[NDArray[np.float32]] = []
    for column in columns:
        before = [layout[at].itemsize for at in range(column)]
        kind, (many,) = layout[column].base, layout[column].shape
        values = np.frombuffer(data, kind, count * many, offset=count * sum(before))
        with np.errstate(over="ignore"):
            read.append(values[::many].astype(np.float32))
    return np.stack(read, axis=1)


def _layout(path: Path, header: dict[str, list[str]]) -> tuple[np.dtype[np.void], list[int]]:
    """A point's record, and which of its fields are x, y and z."""
    fields = header["FIELDS"]
    sizes, types = header.get("SIZE", []), header.get("TYPE", [])
    counts = header.get("COUNT", ["1"] * len(fields))
    try:
        layout = np.dtype(
            [
                (f"{i}", _TYPES[kind, int(size)], (int(many),))
                for i, (size, kind, many) in enumerate(zip(sizes, types, counts, strict=True))
            ]
        )
        columns = [fields.index(name) for name in ("x", "y", "z")]
        if len(layout.names or ()) != len(fields):
            raise ValueError("FIELDS, SIZE, TYPE and COUNT differ in length")
        if any(int(counts[column]) < 1 for column in columns):
            raise ValueError("x, y and z need COUNT 1")
    except (KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise WorldError(f"point cloud {path} has a malformed header: {error}") from error
    return layout, columns


def _xyz(values: NDArray[np.float32], fields: list[str]) -> Points:
    columns = [fields.index(name) for name in ("x", "y", "z")]
    return np.ascontiguousarray(values[:, columns])
