"""Targets: what robots send of their scans. The checksum is put on here: no guess would hit it."""

from __future__ import annotations

import zlib

import numpy as np

from perception.codec.boxes import decode_boxes
from perception.codec.envelope import seal, unseal
from perception.codec.features import decode_cells, encode_cells
from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from research.fuzz.target import Target
from swarm.errors import PayloadError

WEIGHTS = 7
SHAPE = (16, 24)
CHANNELS, PARTS = 6, 2
_DEFLATED_AT = 40
"""Where a map's deflated parts begin; the length of the first stands before it."""

_PLACES_BYTES = SHAPE[0] * SHAPE[1] // 8


def _points(data: bytes) -> None:
    """The kind and the body; with the kind's highest bit set the rest is the whole payload."""
    if not data:
        return
    payload = data[1:] if data[0] & 0x80 else seal(data[0], data[1:])
    try:
        payload, places = take_outline(payload)
        assert np.isfinite(places).all()
    except PayloadError:
        pass
    cloud = decode_points(payload)
    assert cloud.dtype == np.float32
    assert cloud.shape == (len(cloud), 3)


def _boxes(data: bytes) -> None:
    if not data:
        return
    boxes = decode_boxes(seal(data[0], data[1:]))
    assert len(boxes.labels) == len(boxes.centers) == len(boxes.headings)
    assert np.isfinite(boxes.centers).all()


def _features(data: bytes) -> None:
    """The kind and the body. With the kind's highest bit set the parts of the body that are
    deflated come plain: guesses make few streams that can be inflated."""
    if not data:
        return
    kind, body = data[0] & 0x7F, data[1:]
    if data[0] & 0x80:
        head, plain = body[: _DEFLATED_AT - 4], body[_DEFLATED_AT:]
        places, values = (
            zlib.compress(part, 1) for part in (plain[:_PLACES_BYTES], plain[_PLACES_BYTES:])
        )
        body = head + len(places).to_bytes(4, "little") + places + values
    block = decode_cells(seal(kind, body), WEIGHTS, SHAPE, CHANNELS, PARTS)
    assert block.values.shape == (PARTS if block.coded else CHANNELS, block.present.sum())
    assert unseal(encode_cells(block))[0] == kind


POINTS = Target(_points, (PayloadError,))
BOXES = Target(_boxes, (PayloadError,))
FEATURES = Target(_features, (PayloadError,))
