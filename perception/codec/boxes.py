"""Boxes on the wire: 20 bytes each and a table of labels.

Body: uint32 count, uint8 number of labels, float64 origin (3), the labels (uint8 length, UTF-8),
then the columns one after the other: centres as 3-byte little-endian integers in 5 mm steps from
the origin, sizes uint16 in 5 mm, headings uint16 in 2 pi / 65536, scores uint16 in 1 / 65535,
label index uint8.

Error bounds: centre and size 2.5 mm an axis, heading 4.8e-5 rad, score 7.7e-6.
"""

from __future__ import annotations

import math
import struct

import numpy as np
from numpy.typing import NDArray

from perception.codec.envelope import seal, unseal
from perception.types import Boxes
from swarm.errors import PayloadError, PerceptionError

KIND_BOXES = 16
STEP_M = 0.005
BYTES_PER_BOX = 20
_HEAD = struct.Struct("<IB3d")
_SPAN = 1 << 23
_TURN = 65536 / math.tau


def encode_boxes(boxes: Boxes) -> bytes:
    """The payload of N boxes.

    Raises PerceptionError when a number is not finite, a centre lies more than 41 km from the
    first one, a size is negative or above 327 m, or there are more than 255 labels.
    """
    origin = boxes.centers[0] if len(boxes) else np.zeros(3)
    names = sorted(set(boxes.labels))
    texts = [name.encode() for name in names]
    if len(names) > 255 or any(len(text) > 255 for text in texts):
        raise PerceptionError(f"boxes have {len(names)} labels; allowed: 255 of up to 255 bytes")
    centers = _steps(boxes.centers - origin, STEP_M, -_SPAN, _SPAN - 1, "centre")
    sizes = _steps(boxes.sizes, STEP_M, 0, 65535, "size")
    headings = _steps(boxes.headings % math.tau, 1 / _TURN, 0, 65536, "heading") % 65536
    scores = _steps(boxes.scores, 1 / 65535, 0, 65535, "score")
    index = {name: i for i, name in enumerate(names)}
    octets = centers.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :3]
    return seal(
        KIND_BOXES,
        _HEAD.pack(len(boxes), len(names), *origin)
        + b"".join(bytes((len(text),)) + text for text in texts)
        + octets.tobytes()
        + sizes.astype("<u2").tobytes()
        + headings.astype("<u2").tobytes()
        + scores.astype("<u2").tobytes()
        + bytes(index[label] for label in boxes.labels),
    )


def decode_boxes(payload: bytes) -> Boxes:
    """The boxes of a payload.

    Raises PayloadError when the payload is corrupt, truncated or of another version.
    """
    kind, body = unseal(payload)
    if kind != KIND_BOXES:
        raise PayloadError(f"payload kind {kind} is not boxes ({KIND_BOXES})")
    if len(body) < _HEAD.size:
        raise PayloadError(f"boxes body has {len(body)} bytes, at least {_HEAD.size} are needed")
    count, label_count, *origin = _HEAD.unpack_from(body)
    names, at = _labels(body, label_count)
    if len(body) - at != BYTES_PER_BOX * count or not np.isfinite(origin).all():
        raise PayloadError(f"boxes body of {len(body)} bytes does not hold {count} boxes")
    octets = np.zeros((3 * count, 4), dtype=np.uint8)
    octets[:, :3] = np.frombuffer(body, np.uint8, 9 * count, at).reshape(-1, 3)
    octets[:, 3] = np.where(octets[:, 2] & 0x80, 0xFF, 0)
    words = np.frombuffer(body, "<u2", 5 * count, at + 9 * count)
    index = body[at + 19 * count :]
    if any(i >= label_count for i in index):
        raise PayloadError(f"a box has label {max(index)}, the table has {label_count}")
    return Boxes(
        centers=octets.view("<i4").reshape(count, 3) * STEP_M + np.array(origin),
        sizes=words[: 3 * count].reshape(count, 3) * STEP_M,
        headings=words[3 * count : 4 * count] / _TURN,
        scores=words[4 * count :] / 65535.0,
        labels=tuple(names[i] for i in index),
    )


def _steps(
    values: NDArray[np.float64], step: float, low: int, high: int, name: str
) -> NDArray[np.int64]:
    """Values in whole steps. Raises PerceptionError when one lies outside low..high steps."""
    steps = np.rint(values / step)
    if not ((steps >= low) & (steps <= high)).all():
        worst = float(values.flat[int(np.argmax(~((steps >= low) & (steps <= high))))])
        raise PerceptionError(
            f"a box has {name} {worst}; allowed: {low * step:.6g} to {high * step:.6g}"
        )
    return steps.astype(np.int64)


def _labels(body: bytes, count: int) -> tuple[list[str], int]:
    """The table of labels and where it ends. Raises PayloadError when it is damaged."""
    names = []
    at = _HEAD.size
    for _ in range(count):
        end = at + 1 + (body[at] if at < len(body) else 0)
        if end > len(body) or at >= len(body):
            raise PayloadError(f"the table of {count} labels is truncated")
        try:
            names.append(body[at + 1 : end].decode())
        except UnicodeDecodeError as error:
            raise PayloadError(f"a label is not UTF-8: {error}") from error
        at = end
    return names, at
