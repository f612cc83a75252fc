"""ROS 2 messages decoded from CDR: bytes checked by hand, and every layout of a cloud."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from options.ros.cdr import CdrError, Cursor
from options.ros.messages import (
    read_cloud,
    read_frame,
    read_odometry,
    read_stamp,
    read_transforms,
)
from options.ros.track import matrix_of
from swarm.geometry import Pose
from tests.support import bag_files
from tests.support.bag_files import STORE

# A cloud of two points in the frame "ab", 16 bytes each: y, x, z, padding.
BY_HAND = bytes.fromhex(
    "00010000"  # CDR, little endian
    "05000000 06000000"  # 5 s 6 ns
    "03000000 61620000"  # "ab", its zero, one byte of padding
    "01000000 02000000"  # 1 row of 2
    "03000000"  # three fields
    "02000000 78000000 04000000 07000000 01000000"  # x at 4, float32, one
    "02000000 79000000 00000000 07000000 01000000"  # y at 0
    "02000000 7a000000 08000000 07000000 01000000"  # z at 8
    "00000000"  # little endian, three bytes of padding
    "10000000 20000000"  # 16 bytes a point, 32 a row
    "20000000"  # 32 bytes
    "00000040 0000803f 00004040 ffffffff"  # y 2, x 1, z 3
    "0000c07f 0000803f 00004040 ffffffff"  # y NaN
    "01"  # dense, it says
)


def test_bytes_checked_by_hand_are_read() -> None:
    cloud = read_cloud(BY_HAND)
    assert (cloud.stamp_ns, cloud.frame) == (5_000_000_006, "ab")
    assert cloud.points.tolist() == [[1.0, 2.0, 3.0]]
    assert cloud.points.dtype == np.float32
    assert not cloud.points.flags.writeable
    assert read_stamp(BY_HAND[:12]) == 5_000_000_006
    assert read_frame(BY_HAND) == "ab"


def test_transforms_checked_by_hand_are_read_in_big_endian() -> None:
    raw = bytes.fromhex(
        "00000000"  # CDR, big endian
        "00000001"  # one transform
        "00000001 00000002"
        "00000002 6d00 0000"  # "m"
        "00000002 6200"  # "b" ends at byte 26
        "000000000000"  # numbers of 8 bytes begin at byte 32
        "3ff0000000000000 4000000000000000 4008000000000000"  # 1, 2, 3
        "0000000000000000 0000000000000000 0000000000000000 3ff0000000000000"
    )
    (one,) = read_transforms(raw)
    assert (one.stamp_ns, one.parent, one.child) == (1_000_000_002, "m", "b")
    assert (one.translation, one.rotation) == ((1, 2, 3), (0, 0, 0, 1))


def test_a_message_that_ends_early_is_refused() -> None:
    for cut in range(len(BY_HAND) - 1):
        with pytest.raises(CdrError):
            read_cloud(BY_HAND[:cut])


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [
        (0, 7, "encapsulation is 1793; allowed: 0"),
        (28, 200, "a sequence of 200, more than its bytes"),
        (44, 2, "field 'x' has datatype 2; allowed: 7"),
        (40, 14, "field 'x' .1 numbers at byte 14. does not fit a point of 16 bytes"),
        (36, 0x77, "no field 'x'; it has w, y, z"),
        (24, 3, "3 points of 16 bytes.* do not fit its 32 bytes"),
        (96, 0, "does not fit a point of 0 bytes"),
    ],
)
def test_a_malformed_cloud_is_refused_by_what_is_wrong(at: int, value: int, words: str) -> None:
    raw = bytearray(BY_HAND)
    raw[at] = value
    with pytest.raises(CdrError, match=words):
        read_cloud(bytes(raw))


POINTS = np.array([[1, 2, 3], [-4, 5.5, 0.25], [7, 8, 9], [10, -11, 12]])


@pytest.mark.parametrize("layout", ["<f4", ">f4", "<f8", ">f8"])
@pytest.mark.parametrize("order", ["xyz", "zxy", "yzx"])
@pytest.mark.parametrize(("gap", "rows", "row_gap"), [(0, 1, 0), (4, 2, 0), (8, 2, 5), (3, 4, 16)])
@pytest.mark.parametrize("little", [True, False])
def test_every_layout_gives_the_same_points(
    layout: str, order: str, gap: int, rows: int, row_gap: int, little: bool
) -> None:
    message = bag_files.cloud(
        5, POINTS, layout=layout, order=order, gap=gap, rows=rows, row_gap=row_gap
    )
    raw = STORE.serialize_cdr(message, bag_files.CLOUD, little_endian=little)
    assert np.array_equal(read_cloud(raw).points, POINTS.astype(np.float32))


def test_missing_returns_are_left_out() -> None:
    missing = [[math.nan, 1, 2], [1, math.inf, 2], [0, 0, 0], [1e300, 0, 0]]
    message = bag_files.cloud(5, np.array([*missing, [1, 0, 0]]), layout="<f8")
    points = read_cloud(STORE.serialize_cdr(message, bag_files.CLOUD)).points
    assert points.tolist() == [[1, 0, 0]]


def test_an_empty_cloud_has_no_points() -> None:
    message = bag_files.cloud(5, np.zeros((0, 3)))
    assert read_cloud(STORE.serialize_cdr(message, bag_files.CLOUD)).points.shape == (0, 3)


@pytest.mark.parametrize("little", [True, False])
def test_odometry_and_transforms_agree_with_another_implementation(little: bool) -> None:
    pose = Pose(1, -2, 3, 0.3, -0.2, 2.5)
    message = bag_files.odometry(7, pose, (1, 2, 3), (4, 5, 6), frame="/R1/odom", child="foot")
    raw = STORE.serialize_cdr(message, bag_files.ODOMETRY, little_endian=little)
    found = read_odometry(raw)
    its = found.transform
    assert (its.stamp_ns, its.parent, its.child) == (7, "R1/odom", "foot")
    assert (found.linear, found.angular) == ((1, 2, 3), (4, 5, 6))
    matrix = matrix_of(np.array(its.translation), np.array(its.rotation))
    assert np.allclose(matrix, pose.matrix())

    edges = {("map", "odom"): pose, ("odom", "base_link_with_a_long_name"): Pose(4, 5, 6)}
    raw = STORE.serialize_cdr(
        bag_files.transforms(9, edges), bag_files.TRANSFORMS, little_endian=little
    )
    read = read_transforms(raw)
    assert [(one.parent, one.child) for one in read] == list(edges)
    assert read[1].translation == (4, 5, 6)


def test_numbers_lie_at_multiples_of_their_size() -> None:
    cursor = Cursor(struct.pack("<BBBB B3xI d", 0, 1, 0, 0, 9, 8, 7.0))
    assert (cursor.whole("B"), cursor.whole("I"), cursor.doubles(1)) == (9, 8, (7.0,))
    cursor = Cursor(struct.pack("<BBBB B7x d", 0, 1, 0, 0, 9, 7.0))
    assert (cursor.whole("B"), cursor.doubles(1)) == (9, (7.0,))
