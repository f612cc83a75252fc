"""Feature maps on the wire: which cells, and what is in them.

Body: uint32 version of the weights, uint16 rows, uint16 columns, 6 float32 (the reference pose: x,
y, z, roll, pitch, yaw in the world), uint32 number of cells, uint32 length of the places, the
places, the values. Places are the zlib stream of a bitmap, rows by columns; values the zlib stream
of what is in the cells, one channel after the other: two 4-bit steps of 1/15 a byte (KIND_STEPS),
or one byte a codebook part (KIND_CODES). The kind also tells which numbers the weights were
multiplied in: a map that was made in bfloat16 has KIND_STEPS_SHORT or KIND_CODES_SHORT. What is in
the cells means the same, so every ego fuses both.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from perception.codec.envelope import inflate, seal, unseal
from swarm.errors import PayloadError

KIND_STEPS = 32
KIND_CODES = 33
KIND_STEPS_SHORT = 34
KIND_CODES_SHORT = 35
LEVELS = 15
"""Steps of a feature: half a byte."""
_HEAD = struct.Struct("<IHH6fII")

Numerics = Literal["float32", "bfloat16"]
_KINDS: dict[tuple[bool, Numerics], int] = {
    (False, "float32"): KIND_STEPS,
    (True, "float32"): KIND_CODES,
    (False, "bfloat16"): KIND_STEPS_SHORT,
    (True, "bfloat16"): KIND_CODES_SHORT,
}
"""The kind of a body by whether it is coded, and what its features were computed in."""
_MEANINGS = {kind: meaning for meaning, kind in _KINDS.items()}

Reference = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class CellBlock:
    """Cells of one robot's feature map."""

    version: int
    """Of the weights that made it."""
    shape: tuple[int, int]
    """Rows and columns of the map."""
    reference: Reference
    """The pose in whose frame the map lies."""
    present: NDArray[np.bool_]
    """(rows, columns): which cells there are, N in all."""
    values: NDArray[np.uint8]
    """(channels, N): steps of 1/LEVELS, or numbers of codebook entries; cells in row order."""
    coded: bool
    """Whether the values are codebook entries."""
    numerics: Numerics = "float32"
    """What the robot's network was computed in."""


def encode_cells(block: CellBlock) -> bytes:
    """The payload of some cells."""
    places = zlib.compress(np.packbits(block.present).tobytes(), 9)
    raw = np.ascontiguousarray(block.values).reshape(-1)
    if not block.coded:
        even = np.append(raw, np.zeros(len(raw) % 2, np.uint8)).reshape(-1, 2)
        raw = np.left_shift(even[:, 0], 4, dtype=np.uint8) | even[:, 1]
    head = _HEAD.pack(
        block.version, *block.shape, *block.reference, block.values.shape[1], len(places)
    )
    kind = _KINDS[block.coded, block.numerics]
    return seal(kind, head + places + _deflated(raw.tobytes(), block.coded))


def _deflated(raw: bytes, coded: bool) -> bytes:
    """The zlib stream of cells' values. Steps repeat as runs of zeros and hardly otherwise: looking
    for runs only takes a sixth of the time of looking for any repetition, and finds more."""
    strategy = zlib.Z_DEFAULT_STRATEGY if coded else zlib.Z_RLE
    stream = zlib.compressobj(strategy=strategy)
    return stream.compress(raw) + stream.flush()


def decode_cells(
    payload: bytes, version: int, shape: tuple[int, int], channels: int, parts: int
) -> CellBlock:
    """The cells of a payload, of `channels` features or `parts` codebook entries each.

    Raises PayloadError when it is damaged, or made by other weights or for another grid.
    """
    kind, body = unseal(payload)
    if kind not in _MEANINGS:
        raise PayloadError(f"payload kind {kind} is not a feature map")
    coded, numerics = _MEANINGS[kind]
    if len(body) < _HEAD.size:
        raise PayloadError(f"a feature map's body has {len(body)} bytes, at least {_HEAD.size}")
    theirs, rows, columns, *pose, count, length = _HEAD.unpack_from(body)
    if theirs != version:
        raise PayloadError(
            f"the feature map was made by weights {theirs:08x}; these are {version:08x}"
        )
    if (rows, columns) != shape:
        raise PayloadError(f"the feature map has {rows} x {columns} cells, not {shape}")
    if not np.isfinite(pose).all() or count > rows * columns:
        raise PayloadError(f"the feature map announces {count} cells around {pose}")
    bits = inflate(body[_HEAD.size : _HEAD.size + length], -(-rows * columns // 8), "places")
    present = np.unpackbits(np.frombuffer(bits, np.uint8), count=rows * columns).astype(np.bool_)
    if int(present.sum()) != count:
        raise PayloadError(f"the feature map announces {count} cells and places {present.sum()}")
    wide = parts if coded else channels
    size = wide * count if coded else -(-wide * count // 2)
    raw = np.frombuffer(inflate(body[_HEAD.size + length :], size, "values"), np.uint8)
    if not coded:
        raw = np.stack([raw >> 4, raw & 15], axis=1).reshape(-1)[: wide * count]
    x, y, z, roll, pitch, yaw = pose
    return CellBlock(
        version,
        shape,
        (x, y, z, roll, pitch, yaw),
        present.reshape(shape),
        raw.reshape(wide, count),
        coded,
        numerics,
    )
