"""A feature map on the wire: dense, one number a channel and cell, as published figures count it.

Body: uint32 version (CRC-32 of the weights), uint16 channels, rows, columns, uint8 bytes a number
(2 or 4), float64 (3, 4): the frame it was made in, world_from_ego; then the numbers, little endian.
"""

from __future__ import annotations

import struct

import numpy as np
import torch
from torch import Tensor

from perception.codec.envelope import OVERHEAD, seal, unseal
from swarm.errors import PayloadError
from swarm.geometry import Matrix

KIND_FEATURES = 48
_HEAD = struct.Struct("<I3HB12d")
_TYPES = {2: "<f2", 4: "<f4"}
_LARGEST_HALF = 65504.0
SAME_FRAME_M = 1e-3
"""A map made in another frame of the ego would be fused cell by cell in the wrong place."""


def map_bytes(shape: tuple[int, int, int], number_bytes: int = 2) -> int:
    """Size of the payload of a map (C, H, W)."""
    return OVERHEAD + _HEAD.size + shape[0] * shape[1] * shape[2] * number_bytes


def encode_map(
    feature_map: Tensor, version: int, world_from_ego: Matrix, number_bytes: int = 2
) -> bytes:
    """The payload of a map float32 (C, H, W) in the ego's frame.

    2 bytes a number round to 11 bits, and clip beyond 65504; 4 keep it as it is.
    """
    numbers = feature_map
    if number_bytes == 2:
        numbers = feature_map.clamp(-_LARGEST_HALF, _LARGEST_HALF)
    head = _HEAD.pack(
        version, *feature_map.shape, number_bytes, *world_from_ego[:3].astype(np.float64).flat
    )
    body = numbers.contiguous().numpy().astype(_TYPES[number_bytes]).tobytes()
    return seal(KIND_FEATURES, head + body)


def decode_map(
    payload: bytes, version: int, shape: tuple[int, int, int], world_from_ego: Matrix
) -> Tensor:
    """The map float32 (C, H, W) of a payload.

    Raises PayloadError when it is damaged, truncated, of other weights, of another grid, or made in
    another frame than `world_from_ego`.
    """
    kind, body = unseal(payload)
    if kind != KIND_FEATURES or len(body) < _HEAD.size:
        raise PayloadError(f"payload of kind {kind} is no feature map ({KIND_FEATURES})")
    found, *rest = _HEAD.unpack_from(body)
    sent_shape, number_bytes, frame = tuple(rest[:3]), rest[3], np.array(rest[4:]).reshape(3, 4)
    if found != version:
        raise PayloadError(
            f"feature map of model {found:08x}; this is {version:08x}: other weights"
        )
    if sent_shape != shape or number_bytes not in _TYPES:
        raise PayloadError(
            f"feature map is {sent_shape} with {number_bytes} bytes a number; "
            f"expected {shape} with 2 or 4"
        )
    if len(payload) != map_bytes(shape, number_bytes):
        raise PayloadError(f"feature map of {len(payload)} bytes does not hold {shape}")
    if not np.abs(frame - world_from_ego[:3]).max() <= SAME_FRAME_M:
        raise PayloadError(
            f"feature map was made for an ego at {frame[:2, 3].round(3).tolist()} m; "
            f"the ego's frame is at {world_from_ego[:2, 3].round(3).tolist()} m"
        )
    numbers = np.frombuffer(body, _TYPES[number_bytes], offset=_HEAD.size).astype(np.float32)
    if not np.isfinite(numbers).all():
        raise PayloadError("feature map has numbers that are not finite")
    return torch.from_numpy(numbers.reshape(shape))
