from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.codec.envelope import VERSION, seal
from perception.codec.points import KIND_GENERIC, decode_points, encode_points
from swarm.errors import PayloadError, ScanError


def random_cloud(count: int, seed: int, scale: float = 100.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-scale, scale, (count, 3)).astype(np.float32)


@given(
    st.integers(0, 300),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.001, 0.01, 0.1, 1.0]),
    st.sampled_from([0.01, 1.0, 100.0, 1000.0]),
)
def test_every_point_of_an_unstructured_cloud_keeps_within_the_bound(
    count: int, seed: int, bound: float, scale: float
) -> None:
    cloud = random_cloud(count, seed, scale)
    back = decode_points(encode_points(cloud, bound))
    assert back.dtype == np.float32
    assert back.shape == cloud.shape
    error = np.linalg.norm(back.astype(np.float64) - cloud, axis=1)
    assert error.max(initial=0) <= bound


def test_an_empty_cloud_is_a_valid_payload() -> None:
    assert decode_points(encode_points(np.zeros((0, 3), np.float32))).shape == (0, 3)


def test_points_that_are_not_finite_are_dropped() -> None:
    cloud = random_cloud(10, 1)
    cloud[3, 1] = np.nan
    cloud[7, 0] = np.inf
    assert len(decode_points(encode_points(cloud))) == 8


@pytest.mark.parametrize("bound", [0.0, 0.0009, 1.1, np.nan])
def test_an_error_bound_out_of_range_is_refused(bound: float) -> None:
    with pytest.raises(ScanError, match="max_error_m"):
        encode_points(random_cloud(3, 1), bound)


def test_a_cloud_of_another_shape_or_unit_is_refused() -> None:
    with pytest.raises(ScanError, match="shape"):
        encode_points(np.zeros((4, 4), np.float32))
    with pytest.raises(ScanError, match="1000 m"):
        encode_points(np.array([[12000.0, 0, 0]], np.float32))


def test_a_payload_of_another_version_is_refused_by_number() -> None:
    payload = bytearray(encode_points(random_cloud(3, 1)))
    payload[3] = VERSION + 1
    with pytest.raises(PayloadError, match=f"version {VERSION + 1}"):
        decode_points(bytes(payload))


@given(st.binary(max_size=300))
def test_random_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(PayloadError):
        decode_points(data)


@given(st.binary(max_size=300), st.sampled_from([KIND_GENERIC]))
def test_a_random_body_with_a_right_checksum_gives_points_or_is_refused(
    body: bytes, kind: int
) -> None:
    with contextlib.suppress(PayloadError):
        decode_points(seal(kind, body))


@given(st.data())
def test_a_flipped_bit_or_a_missing_end_is_noticed(data: st.DataObject) -> None:
    payload = bytearray(encode_points(random_cloud(20, 1)))
    at = data.draw(st.integers(0, 8 * len(payload) - 1))
    with pytest.raises(PayloadError):
        decode_points(bytes(payload[: at // 8]))
    payload[at // 8] ^= 1 << at % 8
    with pytest.raises(PayloadError):
        decode_points(bytes(payload))
