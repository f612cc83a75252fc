"""Arrays on the wire: {dtype, shape, bytes}, little endian, C order."""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarm.errors import MessageError

_DTYPES = frozenset({"<f4", "<f8", "<i2", "<i4", "<i8", "|i1", "|u1", "<u2", "<u4", "<u8"})
MAX_DIMENSIONS = 4


class Array(msgspec.Struct, frozen=True):
    """An n-dimensional array as it travels: numpy type string, shape and raw bytes."""

    dtype: str
    shape: tuple[int, ...]
    data: bytes = msgspec.field(name="bytes")


def pack(array: NDArray[np.generic]) -> Array:
    """The wire form of an array. Raises MessageError for a dtype that may not travel."""
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    dtype = little.dtype.str
    if dtype not in _DTYPES:
        raise MessageError(f"array dtype {dtype!r} may not travel; allowed: {sorted(_DTYPES)}")
    return Array(dtype=dtype, shape=array.shape, data=little.tobytes())


def unpack(array: Array) -> NDArray[np.generic]:
    """A read-only view on the bytes of a wire array.

    Raises MessageError when dtype, shape and number of bytes do not fit together.
    """
    if array.dtype not in _DTYPES:
        raise MessageError(f"array dtype {array.dtype!r} is not one of {sorted(_DTYPES)}")
    if len(array.shape) > MAX_DIMENSIONS or any(n < 0 for n in array.shape):
        raise MessageError(f"array shape {array.shape} is not up to {MAX_DIMENSIONS} sizes >= 0")
    dtype = np.dtype(array.dtype)
    expected = math.prod(array.shape) * dtype.itemsize
    if expected != len(array.data):
        raise MessageError(
            f"array of dtype {array.dtype} and shape {array.shape} needs {expected} bytes, "
            f"has {len(array.data)}"
        )
    try:
        return np.frombuffer(array.data, dtype=dtype).reshape(array.shape)
    except (ValueError, OverflowError) as error:
        # An empty array may still name a size that numpy cannot hold.
        raise MessageError(f"array shape {array.shape} cannot be used: {error}") from error


def unpack_finite(array: Array, name: str, columns: int) -> NDArray[np.float32]:
    """A wire array that must be float32 (N, columns) and finite, or MessageError naming it."""
    values = unpack(array)
    if values.dtype != np.float32 or values.ndim != 2 or values.shape[1] != columns:
        raise MessageError(
            f"{name} must be float32 of shape (N, {columns}), is {array.dtype} {array.shape}"
        )
    if not np.isfinite(values).all():
        raise MessageError(f"{name} holds NaN or infinite values")
    return values.astype(np.float32, copy=False)
