"""A live robot as a world: what comes on a real router, and what is said when it is missing."""

from __future__ import annotations

import itertools
import re
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from options.ros2 import keys
from options.ros2.address import parse
from options.ros2.world import LiveWorld
from swarm.errors import SilentError, WorldError
from swarm.geometry import Pose
from swarm.log import make_logger
from tests.support.bag_files import CLOUD, ODOMETRY, TRANSFORMS, cloud, odometry, transforms
from tests.support.ros2_robot import CORNER, Robot
from tests.support.zenoh_fixtures import RouterProcess, until
from worlds.base import Scan

MOUNT = Pose(0.2, 0, 1.2)
_domains = itertools.count(1)

Live = Callable[..., tuple[Robot, LiveWorld]]


def opened(text: str) -> LiveWorld:
    return LiveWorld(parse(text), "R1", "test", make_logger("test", level="error"))


@pytest.fixture
def live(shared_router: RouterProcess) -> Iterator[Live]:
    """A robot in a domain of its own, and the world that reads it."""
    with ExitStack() as stack:

        def make(options: str = "odom=/odom", **how: Any) -> tuple[Robot, LiveWorld]:
            port, domain = shared_router.port, next(_domains)
            text = f"ros2://127.0.0.1:{port}/{domain}?points=/points&{options}"
            world = stack.enter_context(opened(text))
            robot = stack.enter_context(Robot(port, domain, **how))
            return robot, world

        yield make


def scan_of(world: LiveWorld) -> Scan:
    """The first scan that the world can give."""
    found: list[Scan] = []

    def there() -> bool:
        try:
            found.append(world.scan("R1", 0))
        except WorldError:
            return False
        return True

    until(there, "the world has a scan")
    return found[0]


def aged(robot: Robot, now_ns: int) -> NDArray[np.float64]:
    """A scan whose point says how old the robot is."""
    return np.array([[robot.age_s(now_ns), 1, 1]])


def wait_for(world: LiveWorld, words: str, kind: type[WorldError] = SilentError) -> None:
    """Returns when the world says, as that kind of error, that something is missing."""
    said: list[str] = []

    def says() -> bool:
        try:
            world.scan("R1", 0)
        except kind as error:
            said.append(str(error))
            return re.search(words, said[-1]) is not None
        except WorldError as error:
            said.append(str(error))
        return False

    until(says, f"it says {words!r}; it said {said[-1:]}")


def test_scans_come_with_the_pose_at_their_own_time(live: Live) -> None:
    robot, world = live("odom=/odom&origin=10,0,0,0,0,1.5707963267948966")
    robot.drive(Pose(1, 2, 0), speed=1.0)
    robot.mount(MOUNT)
    robot.every(0.05, lambda now: robot.say("/points", CLOUD, cloud(now, aged(robot, now))))
    first = scan_of(world)
    assert first.points[0, 1:] == pytest.approx((1, 1))
    assert first.velocity == pytest.approx((0, 1, 0), abs=1e-6)
    until(lambda: scan_of(world).captured_ns != first.captured_ns, "another scan comes")
    for scan in (first, scan_of(world)):
        # A quarter turn of the robot's map: its x is the world's y.
        driven = 1.2 + scan.points[0, 0]
        assert (scan.pose.x, scan.pose.y, scan.pose.z) == pytest.approx((8, driven, 1.2), abs=1e-4)
    assert len(world.ground_truth(0).boxes) == 0
    with pytest.raises(WorldError, match="'R2' is not 'R1'"):
        world.scan("R2", 0)


def test_a_robot_may_come_late_and_have_said_its_mount_before(
    live: Live, shared_router: RouterProcess
) -> None:
    robot, world = live("odom=/odom&max_age=30")
    wait_for(world, "nobody publishes topic /points in domain .*PointCloud2 comes on no topic")
    robot.announce("/points", CLOUD)
    wait_for(world, "/points is announced, but nothing has come on it yet")
    robot.mount(MOUNT)
    robot.drive(Pose(1, 2, 0))
    robot.scans()
    assert scan_of(world).pose == Pose(1.2, 2, 1.2)
    assert world.scan("R1", 3).frame == 3
    assert world.pose("R1", 3) == Pose(1.2, 2, 1.2)
    # A second world opens when everything has been said.
    text = f"ros2://127.0.0.1:{shared_router.port}/{robot.domain}?points=/points&odom=/odom"
    with opened(text) as second:
        assert scan_of(second).pose == Pose(1.2, 2, 1.2)


def test_tf_says_where_the_robot_is(live: Live) -> None:
    robot, world = live("tf=/tf")
    robot.mount(MOUNT)
    begun = robot.now_ns()

    def moves(now: int) -> None:
        at = Pose((now - begun) / 1e9, 0, 0)
        robot.say("/tf", TRANSFORMS, transforms(now, {("odom", "base_link"): at}))

    robot.scans()
    wait_for(world, "nobody publishes topic /tf in domain|leads from none of map, odom to 'lidar'")
    robot.every(0.01, moves)
    scan = scan_of(world)
    assert scan.velocity[1:] == (0, 0)
    assert (scan.pose.y, scan.pose.z) == (0, 1.2)
    # A better fixed frame, which is corrected rarely.
    robot.say("/tf", TRANSFORMS, transforms(robot.now_ns(), {("map", "odom"): Pose(0, 50, 0)}))
    until(lambda: scan_of(world).pose.y == 50, "the map leads to the robot")
    until(lambda: scan_of(world).velocity == pytest.approx((1, 0, 0), abs=0.05), "it moves")


def test_a_clock_that_is_off_changes_no_age(live: Live) -> None:
    robot, world = live(clock_s=-5000.0)
    robot.mount(MOUNT)
    robot.drive(Pose(1, 2, 0))
    robot.scans()
    scan_of(world)
    time.sleep(0.2)
    captured_ns = scan_of(world).captured_ns
    assert captured_ns is not None
    assert abs(time.time_ns() - captured_ns) < 60_000_000_000


def test_a_scan_that_is_long_on_its_way_is_as_old_as_that(live: Live) -> None:
    """Poses come at once, and tell what the scans' way adds to their age."""
    robot, world = live("odom=/odom&sensor=0,0,1&max_age=30")
    took_s = 10.0
    took_ns = round(took_s * 1e9)
    robot.every(
        0.01, lambda now: robot.say("/odom", ODOMETRY, odometry(now - took_ns, Pose(1, 2, 0)))
    )
    stamps: list[int] = []

    def scan(now: int) -> None:
        stamps.append(now - took_ns)
        robot.say("/points", CLOUD, cloud(stamps[-1], CORNER), took_s=took_s)

    robot.every(0.05, scan)
    captured_ns = scan_of(world).captured_ns
    assert captured_ns is not None
    # The stamp on the clock of this machine, which is the robot's.
    assert min(abs(captured_ns - stamp_ns) for stamp_ns in stamps) < took_ns / 4


def test_what_falls_silent_is_not_shown_as_live(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.drive(Pose(1, 2, 0))
    going = robot.scans()
    scan_of(world)
    going.set()
    wait_for(world, r"topic /points has been silent for \d+\.\d s; allowed: 0.5 s")
    with pytest.raises(SilentError):
        world.pose("R1", 0)
    robot.scans()
    assert scan_of(world).pose == Pose(1, 2, 1)


def test_a_scan_from_before_the_first_pose_has_none(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1&max_age=30")
    before_ns = robot.now_ns()
    robot.every(0.05, lambda now: robot.say("/points", CLOUD, cloud(before_ns, CORNER)))
    robot.drive(Pose(1, 2, 0), speed=1.0)
    wait_for(world, "no pose on /odom is near the newest scan on /points")


def test_without_odometry_there_is_no_scan(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.scans()
    wait_for(
        world, r"nobody publishes topic /odom in domain \d+; nav_msgs/msg/Odometry comes on no"
    )
    going = robot.drive(Pose(1, 2, 0))
    scan_of(world)
    going.set()
    wait_for(world, "poses on /odom (come too late|end .* before the oldest of the last 8 scans)")
    robot.say("/odom", ODOMETRY, b"\x00\x01\x00\x00half")
    wait_for(world, "a message on /odom is malformed: it ends after 8 bytes")


def test_a_topic_of_another_type_is_named_with_those_of_the_right_one(live: Live) -> None:
    robot, world = live("odom=/wheels")
    robot.say("/points", "std_msgs/msg/String", b"\x00\x01\x00\x00")
    wait_for(world, "topic /points carries std_msgs/msg/String; it must be sensor_msgs/msg/Point")
    other, world = live("odom=/wheels")
    other.scan(topic="/front/points")
    wait_for(world, "nobody publishes topic /points .*PointCloud2 comes on /front/points$")


def test_scans_that_did_not_come_are_counted(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.drive(Pose(1, 2, 0))
    left_out: list[int] = []
    robot.every(0.05, lambda now: robot.scan(skip=left_out.pop() if left_out else 0))
    scan_of(world)
    left_out.append(3)
    until(lambda: world.lost >= 3, "three scans are missing")
    assert scan_of(world).pose == Pose(1, 2, 1)


def test_without_attachments_the_headers_say_when(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.every(
        0.01,
        lambda now: robot.say("/odom", ODOMETRY, odometry(now, Pose(1, 2, 0)), attach=False),
    )
    stamps = []

    def scan(now: int) -> None:
        stamps.append(now)
        robot.say("/points", CLOUD, cloud(now, CORNER), attach=False)

    robot.every(0.05, scan)
    assert scan_of(world).captured_ns in stamps


def test_a_scan_without_a_stamp_was_taken_when_it_was_published(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.drive(Pose(0, 0, 0), speed=1.0)
    robot.every(0.05, lambda now: robot.say("/points", CLOUD, cloud(0, aged(robot, now))))

    def near() -> bool:
        # Between making a message and publishing it a busy machine may take longer.
        scan = scan_of(world)
        return abs(scan.pose.x - scan.points[0, 0]) < 0.2

    until(near, "the place at which it was published")


@pytest.mark.parametrize(
    ("shift_s", "words"),
    [
        (-300, r"scans on /points are stamped 3\d\d\.\d+ s before now; allowed: 0.5 s .*=arrival"),
        (
            300,
            r"a scan on /points is stamped [23]\d\d\.\d+ s after it came; allowed: 0.1 s.*=arrival",
        ),
    ],
)
def test_stamps_of_another_clock_are_refused_or_left_aside(
    live: Live, shared_router: RouterProcess, shift_s: int, words: str
) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    shift_ns = shift_s * 1_000_000_000

    def say(now: int) -> None:
        robot.say("/odom", ODOMETRY, odometry(now + shift_ns, Pose(1, 2, 0)))
        robot.say("/points", CLOUD, cloud(now + shift_ns, CORNER))

    robot.every(0.05, say)
    wait_for(world, words)
    text = (
        f"ros2://127.0.0.1:{shared_router.port}/{robot.domain}?points=/points&odom=/odom"
        "&sensor=0,0,1&stamps=arrival"
    )
    with opened(text) as world:
        captured_ns = scan_of(world).captured_ns
        assert captured_ns is not None
        assert abs(time.time_ns() - captured_ns) < 60_000_000_000


def test_missing_returns_are_left_out_and_other_clouds_are_refused(live: Live) -> None:
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.drive(Pose(1, 2, 0))
    holes = np.concatenate([CORNER, [[np.nan, 1, 1], [0, 0, 0]]]).astype(np.float32)
    going = robot.scans(holes)
    np.testing.assert_array_equal(scan_of(world).points, CORNER)
    going.set()

    def flat(now: int) -> None:
        message = cloud(now, CORNER)
        message.fields[2].name = "depth"
        robot.say("/points", CLOUD, message)

    odd = robot.every(0.02, flat)
    # So long as the scan before is fresh the robot keeps it; then it has nothing to tell.
    wait_for(world, "a scan on /points is malformed: it has no field 'z'", WorldError)
    wait_for(world, "a scan on /points is malformed: it has no field 'z'", SilentError)
    odd.set()
    robot.every(0.02, lambda now: robot.say("/points", CLOUD, cloud(now, CORNER, "odom")))
    wait_for(world, "scans on /points are in 'odom', a frame that stays; it must be the sensor's")


def test_a_cloud_in_a_frame_that_nothing_leads_to_is_named(live: Live) -> None:
    robot, world = live()
    robot.drive(Pose(1, 2, 0), child="base_link")
    robot.mount(MOUNT, base="trailer")
    robot.scans()
    wait_for(world, "nothing says where 'lidar', the frame of /points, is on 'base_link', the fra")


def test_the_bytes_on_the_wire_are_read_by_hand(live: Live) -> None:
    """Both messages as hand-made CDR: nothing of a library's in between."""
    robot, world = live("odom=/odom&tf_static=/tf_static")

    def text(value: bytes, at: int) -> bytes:
        raw = struct.pack("<I", len(value) + 1) + value + b"\0"
        return raw + bytes(-(at + len(raw)) % 4)

    def points(now: int) -> bytes:
        body = struct.pack("<iI", now // 10**9, now % 10**9) + text(b"base", 8)
        body += struct.pack("<II", 1, 2) + struct.pack("<I", 3)
        for place, name in enumerate((b"x", b"y", b"z")):
            body += text(name, len(body)) + struct.pack("<IB3xI", 4 * place, 7, 1)
        body += struct.pack("<B3xII", 0, 12, 24)
        body += struct.pack("<I6f", 24, 1, 2, 3, 4, 5, 6) + b"\x01"
        return b"\x00\x01\x00\x00" + body

    def place(now: int) -> bytes:
        body = struct.pack("<iI", now // 10**9, now % 10**9) + text(b"odom", 8)
        body += text(b"base", len(body))
        body += bytes(-len(body) % 8) + struct.pack("<7d", 7, 8, 9, 0, 0, 0, 1) + bytes(36 * 8)
        body += struct.pack("<6d", 0.5, 0, 0, 0, 0, 0) + bytes(36 * 8)
        return b"\x00\x01\x00\x00" + body

    robot.every(0.02, lambda now: robot.say("/odom", ODOMETRY, place(now)))
    robot.every(0.05, lambda now: robot.say("/points", CLOUD, points(now)))
    scan = scan_of(world)
    np.testing.assert_array_equal(scan.points, [[1, 2, 3], [4, 5, 6]])
    assert scan.pose == Pose(7, 8, 9)
    assert scan.velocity == (0.5, 0, 0)


def test_ros_sees_who_listens(live: Live) -> None:
    """As `ros2 topic info` would."""
    robot, world = live()
    robot.announce("/points", CLOUD)
    wait_for(world, "/points is announced")
    ours = f"@ros2_lv/{robot.domain}/*/0/*/MS/%/%/coadapt_test_R1/%points/**"

    def shown() -> bool:
        replies = list(robot.session.liveliness().get(ours, timeout=5))
        return any(reply.ok is not None for reply in replies)

    until(shown, "the subscription is shown")


def test_a_robot_that_publishes_only_to_known_subscriptions_is_read(live: Live) -> None:
    robot, world = live(buffers=True)
    robot.mount(MOUNT)
    robot.drive(Pose(1, 2, 0))
    robot.scans()
    assert scan_of(world).pose == Pose(1.2, 2, 1.2)


def test_a_router_that_was_no_use_at_first_is_used_later(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keys, "node_token", lambda *_: "no//key")
    robot, world = live("odom=/odom&sensor=0,0,1")
    robot.drive(Pose(1, 2, 0))
    robot.scans()
    wait_for(world, r"the router at tcp/127.* cannot be used: Invalid Key Expr `no//key`")
    monkeypatch.undo()
    assert scan_of(world).pose == Pose(1, 2, 1)


def test_a_router_that_is_not_there_yet_is_named() -> None:
    with (
        opened("ros2://127.0.0.1:1/0?points=/points&odom=/odom") as world,
        pytest.raises(SilentError, match=r"no Zenoh router at tcp/127\.0\.0\.1:1 yet"),
    ):
        world.scan("R1", 0)


def test_a_robot_comes_back_with_its_router(own_router: RouterProcess) -> None:
    text = f"ros2://127.0.0.1:{own_router.port}/0?points=/points&odom=/odom"
    with opened(text) as world, Robot(own_router.port) as robot:
        robot.mount(MOUNT)
        robot.drive(Pose(1, 2, 0))
        robot.scans()
        scan_of(world)
        own_router.stop(kill=True)
        wait_for(world, "topic /points has been silent")
        own_router.start()
        assert scan_of(world).pose == Pose(1.2, 2, 1.2)
