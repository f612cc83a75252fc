"""Transforms over time."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from options.ros.messages import Transform
from options.ros.track import Track

metres = st.floats(-1000, 1000)
share = st.floats(0, 1)


def at(stamp_s: float, x: float, y: float, z: float) -> Transform:
    half = np.pi / 8
    turned = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
    return Transform(int(stamp_s * 1e9), "map", "base_link", (x, y, z), turned)


@given(metres, metres, metres, share)
def test_what_stands_still_stays_where_it_is_to_the_last_bit(
    x: float, y: float, z: float, share: float
) -> None:
    placed = Track([at(5, x, y, z), at(6, x, y, z)]).at(int((5 + share) * 1e9))
    assert placed.known
    assert tuple(placed.a_from_b[:3, 3]) == (x, y, z)


@given(metres, share)
def test_what_moves_is_on_the_way_between_two_samples(x: float, share: float) -> None:
    placed = Track([at(5, x, 0, 0), at(6, x + 2, 1, 0)]).at(5_000_000_000 + int(share * 1e9))
    np.testing.assert_allclose(placed.a_from_b[:3, 3], (x + 2 * share, share, 0), atol=1e-6)
