"""Arrays on the wire keep type, shape and values, and lie about none of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from swarm.arrays import Array, pack, unpack, unpack_finite
from swarm.errors import MessageError

DTYPES = ["<f4", "<f8", "<i2", "<i4", "<i8", "|i1", "|u1", "<u2", "<u4", "<u8"]
shapes = arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5)


@given(st.sampled_from(DTYPES).flatmap(lambda dtype: arrays.arrays(dtype, shapes)))
def test_an_array_survives_the_wire(values: Any) -> None:
    back = unpack(pack(values))
    assert back.dtype == values.dtype
    assert back.shape == values.shape
    np.testing.assert_array_equal(back, values)


@given(arrays.arrays(">f4", (3, 2), elements=st.floats(-1, 1, width=32)))
def test_big_endian_and_transposed_arrays_travel_little_endian_in_c_order(values: Any) -> None:
    wire = pack(values.T)
    assert wire.dtype == "<f4"
    np.testing.assert_array_equal(unpack(wire), values.T)


def test_an_unpacked_array_cannot_be_written() -> None:
    assert not unpack(pack(np.zeros(3, dtype=np.float32))).flags.writeable


@pytest.mark.parametrize("values", [np.array([object()]), np.array(["a"]), np.array([1 + 2j])])
def test_an_array_of_another_type_may_not_travel(values: Any) -> None:
    with pytest.raises(MessageError, match="may not travel"):
        pack(values)


@pytest.mark.parametrize(
    "wire",
    [
        Array(dtype="|O", shape=(1,), data=bytes(8)),
        Array(dtype=">f4", shape=(1,), data=bytes(4)),
        Array(dtype="<f4,<f4", shape=(1,), data=bytes(8)),
        Array(dtype="nonsense", shape=(1,), data=bytes(8)),
        Array(dtype="<f4", shape=(2,), data=bytes(4)),
        Array(dtype="<f4", shape=(1,), data=bytes(5)),
        Array(dtype="<f4", shape=(-1, -1), data=bytes(4)),
        Array(dtype="<f4", shape=(1, 1, 1, 1, 1), data=bytes(4)),
        Array(dtype="<f4", shape=(2**62, 4), data=bytes(4)),
        Array(dtype="<f4", shape=(0, 2**63), data=b""),
        Array(dtype="<f4", shape=(0, 2**64), data=b""),
    ],
    ids=str,
)
def test_dtype_shape_and_bytes_must_fit_together(wire: Array) -> None:
    with pytest.raises(MessageError):
        unpack(wire)


@given(st.sampled_from(DTYPES), st.lists(st.integers(-(2**63), 2**64), max_size=5), st.binary())
def test_an_invented_array_raises_nothing_but_message_error(
    dtype: str, shape: list[int], data: bytes
) -> None:
    try:
        values = unpack(Array(dtype=dtype, shape=tuple(shape), data=data))
    except MessageError:
        return
    assert values.nbytes == len(data)


def test_a_table_must_have_its_columns_and_finite_numbers() -> None:
    good = np.ones((2, 9), dtype=np.float32)
    np.testing.assert_array_equal(unpack_finite(pack(good), "objects", 9), good)
    for bad in (good[:, :8], good[0], good.astype(np.float64), good * np.float32("nan")):
        with pytest.raises(MessageError, match="objects"):
            unpack_finite(pack(bad), "objects", 9)
