from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.codec.residuals import SYMBOLS, RawBits, to_symbols
from swarm.errors import PayloadError

LARGEST = (1 << 22) - 1


@given(st.lists(st.one_of(st.none(), st.integers(-LARGEST, LARGEST), st.integers(-40, 40))))
def test_residuals_come_back(values: list[int | None]) -> None:
    residual = np.array([value or 0 for value in values], dtype=np.int32)
    present = np.array([value is not None for value in values], dtype=np.bool_)
    symbols, raw = to_symbols(residual, present)
    assert symbols.max(initial=0) < SYMBOLS
    reader = RawBits(raw)
    back, back_present = reader.to_residuals(symbols)
    reader.finish()
    np.testing.assert_array_equal(back, residual)
    np.testing.assert_array_equal(back_present, present)


def test_missing_and_surplus_raw_bits_are_refused() -> None:
    symbols, raw = to_symbols(np.array([1000, -5000], np.int32), np.ones(2, np.bool_))
    with pytest.raises(PayloadError, match="too early"):
        RawBits(raw[:-1]).to_residuals(symbols)
    reader = RawBits(raw + b"\0")
    reader.to_residuals(symbols)
    with pytest.raises(PayloadError, match="left over"):
        reader.finish()
