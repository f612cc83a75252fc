"""The codec writes and reads the same bytes with its loops in C and in NumPy."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.codec import image, rans, residuals, spinning
from perception.codec.points import decode_points, encode_points
from perception.kernels import library
from swarm.errors import PayloadError
from tests.support.codec_scans import room_scan

pytestmark = pytest.mark.skipif(
    library.coding() is None, reason="perception was installed without a compiler"
)


def without_c(patch: pytest.MonkeyPatch) -> None:
    for module in (image, rans, residuals, spinning):
        patch.setattr(module, "coding", lambda: None)


def far_jumps() -> NDArray[np.float32]:
    """Neighbours 100 m apart: residuals of many raw bits."""
    cloud = room_scan(32, 512)
    return (cloud * np.random.default_rng(1).choice([1.0, 12.0], (len(cloud), 1))).astype("f4")


@pytest.mark.parametrize(
    "cloud",
    [
        room_scan(),
        room_scan(1, 777),
        room_scan(7, 500, seed=3),
        room_scan(32, 1024, seed=2, drop=0.5),
        room_scan(64, 90, seed=4),
        far_jumps(),
    ],
    ids=["small", "one ring", "odd rings", "sparse", "few columns", "far jumps"],
)
@pytest.mark.parametrize("max_error_m", [0.005, 0.1])
def test_bytes_and_points_are_the_same(
    cloud: NDArray[np.float32], max_error_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_c = encode_points(cloud, max_error_m)
    decoded_in_c = decode_points(in_c)
    without_c(monkeypatch)
    assert encode_points(cloud, max_error_m) == in_c
    np.testing.assert_array_equal(decode_points(in_c), decoded_in_c)


def verdict(payload: bytes) -> str | bytes:
    try:
        return decode_points(payload).tobytes()
    except PayloadError as error:
        return str(error)


@pytest.mark.parametrize("seed", range(60))
def test_what_is_damaged_is_judged_the_same(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    payload = bytearray(encode_points(room_scan(8, 300, seed=1), 0.02))
    for _ in range(rng.integers(1, 4)):
        # Beyond the header, whose damage is found before any loop.
        payload[rng.integers(60, len(payload) - 4)] = rng.integers(256)
    payload[-4:] = zlib.crc32(payload[:-4]).to_bytes(4, "little")
    in_c = verdict(bytes(payload))
    without_c(monkeypatch)
    assert verdict(bytes(payload)) == in_c
