"""Where a live robot is, by messages of chosen times and in a chosen order."""

from __future__ import annotations

from typing import Any

import pytest

from options.ros2.address import parse
from options.ros2.topic_buffer import Arrived, TopicBuffer
from options.ros2.whereabouts import MAX_FRAMES, Whereabouts, find_whereabouts
from swarm.errors import WorldError
from swarm.geometry import Pose
from tests.support.bag_files import ODOMETRY, STORE, TRANSFORMS, ns, odometry, transforms

MAP, ODOM, MOUNT = ("map", "odom"), ("odom", "base_link"), ("base_link", "lidar")


class Told:
    """A robot whose messages a test writes one by one; times are in seconds."""

    def __init__(self, poses: str) -> None:
        """`poses`: the address's option, odom or tf."""
        address = parse(f"ros2://robot/0?points=/points&{poses}=/poses&tf_static=/still")
        kind = ODOMETRY if address.odom else TRANSFORMS
        self.poses = TopicBuffer("/poses", kind, 10_000)
        self.static = TopicBuffer("/still", TRANSFORMS, 10_000)
        self.where: Whereabouts = find_whereabouts(address, self.poses, self.static)
        self.put(self.static, transforms(ns(0), {MOUNT: Pose(0, 0, 1)}))

    def put(self, buffer: TopicBuffer, message: Any) -> None:
        """A message, or bytes as they are, just as it comes."""
        if not isinstance(message, bytes):
            message = bytes(STORE.serialize_cdr(message, buffer.kind))
        buffer.put(Arrived(message, 0, None))
        self.where.update()

    def tf(self, time_s: float, edge: tuple[str, str], x: float) -> None:
        self.put(self.poses, transforms(ns(time_s), {edge: Pose(x, 0, 0)}))

    def drive(self, begin_s: float, end_s: float, speed: float = 0.0) -> None:
        """Where the base is in odom, at 50 Hz, x = speed * time."""
        for step in range(round(begin_s * 50), round(end_s * 50) + 1):
            self.tf(step / 50, ODOM, speed * step / 50)

    def odometry(self, time_s: float, x: float) -> None:
        self.put(self.poses, odometry(ns(time_s), Pose(x, 0, 0)))

    def x(self, time_s: float) -> float:
        """Where the sensor is known to be, metres."""
        placed = self.where.at("lidar", ns(time_s))
        assert placed.known
        return float(placed.a_from_b[0, 3])


@pytest.fixture
def tf() -> Told:
    return Told("tf")


@pytest.fixture
def odom() -> Told:
    return Told("odom")


@pytest.mark.parametrize("second_s", [0.5, 0.15])
def test_a_correction_holds_until_the_next_one_however_late(tf: Told, second_s: float) -> None:
    tf.tf(0, MAP, 10)
    tf.tf(second_s, MAP, 20)
    tf.drive(0, 6, speed=1)
    assert tf.where.newest_ns("lidar") == ns(6)
    assert tf.x(3.5) == pytest.approx(23.5)
    tf.tf(4, MAP, 30)
    assert tf.x(3.99) == pytest.approx(23.99)
    assert tf.x(4) == pytest.approx(34)


def test_before_the_first_correction_that_one_holds(tf: Told) -> None:
    tf.drive(0, 2, speed=1)
    tf.tf(1, MAP, 10)
    tf.tf(2, MAP, 20)
    assert tf.x(0.5) == pytest.approx(10.5)


def test_a_correction_of_a_robot_that_stands_still_is_no_motion(tf: Told) -> None:
    for step in range(5):
        tf.tf(step / 2, MAP, step)
    tf.drive(0, 2)
    for time_s in (0.49, 0.51, 1.03, 1.25, 2):
        assert tf.where.velocity("lidar", ns(time_s)) == (0, 0, 0)
    assert tf.x(1.25) == 2


def test_corrections_may_be_stamped_ahead_of_their_time(tf: Told) -> None:
    """As those of a localization that promises to hold for a while."""
    for step in range(30):
        tf.tf(1 + step / 10, MAP, step)
    tf.drive(0, 3)
    assert tf.where.newest_ns("lidar") == ns(3)
    assert tf.x(2.55) == 15


def test_a_base_that_falls_silent_is_lost_whatever_corrects_it(tf: Told) -> None:
    tf.drive(0, 2)
    for step in range(40):
        tf.tf(step / 10, MAP, 0)
    assert tf.where.newest_ns("lidar") == ns(2)
    assert not tf.where.at("lidar", ns(3.9)).known


def test_what_alone_moves_the_robot_is_interpolated(tf: Told) -> None:
    """Localization by the LiDAR alone, on odometry that stands still."""
    tf.put(tf.static, transforms(ns(0), {ODOM: Pose(0, 0, 0)}))
    tf.tf(0, MAP, 0)
    tf.tf(0.5, MAP, 1)
    assert tf.where.newest_ns("lidar") == ns(0.5)
    assert tf.x(0.25) == pytest.approx(0.5)


def test_frames_without_end_are_forgotten_but_the_robots_own(tf: Told) -> None:
    tf.tf(0, MAP, 5)
    tf.drive(0, 0.1)
    assert tf.x(0.1) == 5
    for track in range(4 * MAX_FRAMES):
        tf.tf(1 + track / 100, ("map", f"track_{track}"), 0)
    assert tf.x(0.1) == 5
    with pytest.raises(WorldError, match="it has ") as told:
        tf.where.at("nowhere", ns(0))
    assert str(told.value).count("map -> track_") == MAX_FRAMES
    assert f"map -> track_{4 * MAX_FRAMES - 1}" in str(told.value)


def test_a_clock_that_is_set_back_a_little_mixes_no_poses(tf: Told, odom: Told) -> None:
    """By 1 s, less than is kept; meanwhile the robot drove on."""
    for step in range(100):
        odom.odometry(step / 50, step)
        tf.tf(step / 50, ODOM, step)
    for step in range(50, 100):
        odom.odometry(step / 50, 1000 + step)
        tf.tf(step / 50, ODOM, 1000 + step)
    for told in (odom, tf):
        assert told.where.newest_ns("lidar") == ns(1.98)
        assert told.x(1.51) == pytest.approx(1075.5)
        assert not told.where.at("lidar", ns(0.9)).known


def test_a_pose_that_was_overtaken_loses_none(odom: Told) -> None:
    for step in (0, 1, 3, 2, 4):
        odom.odometry(step / 10, step)
    assert odom.x(0.05) == pytest.approx(0.5)
    assert odom.x(0.25) == pytest.approx(2.5)


@pytest.mark.parametrize("poses", ["odom", "tf"])
def test_a_malformed_message_is_named_until_its_topic_brings_a_good_one(poses: str) -> None:
    told = Told(poses)
    good = odometry(ns(1), Pose(0, 0, 0)) if poses == "odom" else transforms(ns(1), {})
    assert told.where.fault == ""
    told.put(told.static, b"\x00\x01\x00\x00bad")
    told.put(told.poses, b"\x00\x01\x00\x00half")
    assert "a message on /poses is malformed" in told.where.fault
    told.put(told.poses, good)
    assert "a message on /still is malformed" in told.where.fault
    told.put(told.static, transforms(ns(0), {MOUNT: Pose(0, 0, 1)}))
    assert told.where.fault == ""
