from __future__ import annotations

import contextlib
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from perception.codec.envelope import seal, unseal
from perception.codec.points import KIND_GENERIC, KIND_SPINNING, decode_points, encode_points
from perception.scene import ground_mask
from swarm.errors import PayloadError
from tests.support.codec_scans import room_scan
from tests.support.paths import GOLDEN
from worlds.factory.world import FactoryWorld
from worlds.opv2v.world import Opv2vWorld

BOUNDS = st.sampled_from([0.001, 0.01, 0.1, 1.0])
Cloud = NDArray[np.float32]


def kind_of(payload: bytes) -> int:
    return unseal(payload)[0]


def assert_one_to_one_within(cloud: Cloud, back: Cloud, bound: float) -> None:
    """Every original point has a decoded point of its own within the bound."""
    assert back.dtype == np.float32
    assert back.shape == cloud.shape
    apart = cdist(cloud.astype(np.float64), back.astype(np.float64))
    # one pair beyond the bound costs more than all within it, so it is taken only if it must be
    cost = np.where(apart <= bound, apart, 2.0 * len(cloud))
    assert apart[linear_sum_assignment(cost)].max(initial=0.0) <= bound


def thinned(cloud: Cloud, count: int = 600) -> Cloud:
    """About that many points of all rings."""
    return cloud[:: -(-len(cloud) // count)]


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 33), st.integers(60, 400), st.integers(0, 1000), BOUNDS, st.floats(-0.01, 0.01)
)
def test_every_point_of_a_scan_keeps_within_the_bound(
    rings: int, columns: int, seed: int, bound: float, phase: float
) -> None:
    cloud = thinned(room_scan(rings, columns, seed, phase=phase))
    assert_one_to_one_within(cloud, decode_points(encode_points(cloud, bound)), bound)


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-5, 0.02), st.integers(0, 1000), st.sampled_from([0.01, 0.1]))
def test_points_beside_their_rays_keep_within_the_bound(
    sigma_m: float, seed: int, bound: float
) -> None:
    cloud = thinned(room_scan(8, 200, seed))
    cloud += np.random.default_rng(seed).normal(0, sigma_m, cloud.shape).astype(np.float32)
    assert_one_to_one_within(cloud, decode_points(encode_points(cloud, bound)), bound)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), BOUNDS)
def test_returns_very_near_the_sensor_and_very_far_keep_within_the_bound(
    seed: int, bound: float
) -> None:
    cloud = room_scan(8, 120, seed)
    scale = 10.0 ** np.random.default_rng(seed).uniform(-4, 1.5, (len(cloud), 1))
    cloud = (cloud * scale).astype(np.float32)
    cloud = thinned(cloud)
    cloud[::50] = 0.0
    assert_one_to_one_within(cloud, decode_points(encode_points(cloud, bound)), bound)


def test_a_scan_takes_the_spinning_form_in_any_order_of_points() -> None:
    cloud = room_scan(32, 512)
    ordered = encode_points(cloud)
    shuffled = encode_points(np.random.default_rng(0).permutation(cloud))
    assert kind_of(ordered) == kind_of(shuffled) == KIND_SPINNING
    assert abs(len(ordered) - len(shuffled)) <= 32


def test_a_part_of_a_scan_takes_the_spinning_form_and_fewer_bytes() -> None:
    cloud = room_scan(32, 1024)
    above = cloud[cloud[:, 2] > -1.5]
    payload = encode_points(above)
    assert kind_of(payload) == KIND_SPINNING
    assert len(payload) < len(encode_points(cloud))
    assert len(decode_points(payload)) == len(above)


def test_two_scans_in_one_cloud_fall_back_to_the_generic_form() -> None:
    one, other = room_scan(16, 512, seed=1), room_scan(16, 512, seed=2)
    moved = other @ np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]], np.float32) + np.float32(3)
    cloud = np.concatenate([one, moved])[::20]
    payload = encode_points(cloud)
    assert kind_of(payload) == KIND_GENERIC
    assert_one_to_one_within(cloud, decode_points(payload), 0.1)


def test_a_point_given_twice_comes_back_twice() -> None:
    cloud = room_scan(16, 256)
    twice = np.concatenate([cloud, cloud[:300]])
    assert len(decode_points(encode_points(twice))) == len(twice)


def test_a_scan_costs_a_third_of_the_generic_form() -> None:
    cloud = room_scan(32, 1024)
    generic = encode_points(cloud + np.random.default_rng(0).uniform(0, 0.5, cloud.shape))
    assert kind_of(generic) == KIND_GENERIC
    assert 3 * len(encode_points(cloud)) < len(generic)


def test_real_frames_keep_to_their_sizes(opv2v_dir: Path) -> None:
    world = Opv2vWorld(opv2v_dir)
    for robot, frame in ((world.robots[0], 0), (world.robots[1], 9)):
        cloud = world.scan(robot, frame).points
        objects = cloud[~ground_mask(cloud)]
        assert len(encode_points(cloud, 0.1)) < 14_000
        assert len(encode_points(cloud, 0.01)) < 33_000
        assert len(encode_points(objects, 0.1)) < 8_500
        payload = encode_points(objects, 0.01)
        assert len(payload) < 16_000
        near = np.linalg.norm(objects, axis=1).argsort()[-2000:]
        back = decode_points(payload)
        assert len(back) == len(objects)
        assert cKDTree(back).query(objects[near])[0].max() <= 0.01


@pytest.mark.parametrize("rings", [16, 64])
def test_simulated_scans_take_the_spinning_form(rings: int) -> None:
    world = FactoryWorld(robots=2, rings=rings)
    cloud = world.scan(world.robots[0], 0).points
    payload = encode_points(cloud)
    assert kind_of(payload) == KIND_SPINNING
    assert len(payload) < len(cloud) / 4


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400))
def test_a_random_body_gives_points_or_is_refused(body: bytes) -> None:
    with contextlib.suppress(PayloadError):
        decode_points(seal(KIND_SPINNING, body))


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_damaged_body_with_a_right_checksum_gives_points_or_is_refused(
    data: st.DataObject,
) -> None:
    body = bytearray(unseal(encode_points(room_scan(8, 200)))[1])
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(body) - 1))
        body[at] = data.draw(st.integers(0, 255))
    del body[data.draw(st.integers(len(body) // 2, len(body))) :]
    with contextlib.suppress(PayloadError):
        back = decode_points(seal(KIND_SPINNING, bytes(body)))
        assert back.ndim == 2


def test_a_small_payload_cannot_ask_for_much_memory() -> None:
    body = bytearray(unseal(encode_points(room_scan(8, 200)))[1])
    body[16:20] = (256).to_bytes(2, "little") + (4096).to_bytes(2, "little")
    tracemalloc.start()
    with pytest.raises(PayloadError):
        decode_points(seal(KIND_SPINNING, bytes(body)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 256 << 20


def test_version_1_payloads_are_read_as_ever() -> None:
    for form in ("spinning", "generic"):
        back = decode_points((GOLDEN / f"points-{form}-v1.bin").read_bytes())
        expected = np.load(GOLDEN / f"points-{form}-v1.npy")
        np.testing.assert_allclose(back, expected, rtol=0, atol=1e-5)
