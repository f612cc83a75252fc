"""Robots' logs as a world: what was recorded comes back, aligned in time and placed."""

from __future__ import annotations

import itertools
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from coadapt.main import main
from options.bags.mcap_file import McapFile
from options.bags.world import BagWorld
from swarm.errors import WorldError
from swarm.geometry import Pose, invert, pose_of, transform
from tests.support.bag_files import (
    CLOUD,
    LATENCY_NS,
    MOUNT,
    ODOMETRY,
    START_NS,
    Log,
    cloud,
    ns,
    odometry,
    plain_log,
    transforms,
)
from worlds.cooperative.fusing import fuse_frame
from worlds.factory.world import FactoryWorld
from worlds.registry import open_world

FRAMES = 5
TIMES = np.arange(30) / 10


@pytest.fixture(scope="module")
def factory() -> FactoryWorld:
    return FactoryWorld(robots=3, rings=16)


@pytest.fixture(scope="module")
def recorded(factory: FactoryWorld, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The factory's first frames as bags: R1 by tf, R2 by odometry, R3 by odometry of its sensor
    from where it started; two storages."""
    folder = tmp_path_factory.mktemp("factory")
    logs = {robot: Log() for robot in factory.robots}
    origin = factory.pose("R3", 0)
    for frame in range(FRAMES):
        stamp = ns(frame / 10)
        for robot, log in logs.items():
            scan = factory.scan(robot, frame)
            log.add("/points", CLOUD, stamp, cloud(stamp, scan.points, "lidar"))
            base = scan.pose.matrix() @ np.linalg.inv(MOUNT["base_link", "lidar"].matrix())
            if robot == "R1":
                halfway = Pose(3, 4, 0, yaw=1.0)
                rest = pose_of(invert(halfway.matrix()) @ base)
                edges = {("map", "odom"): halfway, ("odom", "base_link"): rest}
                log.tf(frame / 10, edges)
            elif robot == "R2":
                message = odometry(stamp, pose_of(base), tuple(body(scan.pose, scan.velocity)))
                log.add("/odom", ODOMETRY, stamp, message)
            else:
                moved = pose_of(np.linalg.inv(origin.matrix()) @ scan.pose.matrix())
                log.add("/odom", ODOMETRY, stamp, odometry(stamp, moved, child="lidar"))
    for robot, log in logs.items():
        if robot != "R3":
            log.tf(0, MOUNT, static=True)
        log.write(folder / robot, "sqlite3" if robot == "R2" else "mcap")
    names = ("x", "y", "z", "roll", "pitch", "yaw")
    values = ", ".join(f"{n} = {v!r}" for n, v in zip(names, origin.as_tuple(), strict=True))
    (folder / "world.toml").write_text(f"[robots.R3]\norigin = {{{values}}}\n")
    return folder


def body(pose: Pose, velocity: tuple[float, float, float]) -> np.ndarray:
    return pose.matrix()[:3, :3].T @ np.array(velocity)


def test_a_recorded_world_gives_back_its_points_and_poses(
    factory: FactoryWorld, recorded: Path
) -> None:
    world = open_world("bag", data=recorded)
    assert (world.name, world.robots) == ("bag", factory.robots)
    assert (world.rate_hz, world.frame_count) == (10.0, FRAMES)
    assert (world.detector, world.range_m) == (factory.detector, factory.range_m)
    for robot in world.robots:
        for frame in range(FRAMES):
            expected, found = factory.scan(robot, frame), world.scan(robot, frame)
            assert np.array_equal(found.points, expected.points)
            assert not found.points.flags.writeable
            assert found.pose.as_tuple() == pytest.approx(expected.pose.as_tuple(), abs=1e-6)
            assert found.pose == world.pose(robot, frame)
            assert (found.robot, found.frame) == (robot, frame)
    # R1's comes from the difference of its poses, R2's from its odometry's twist.
    for robot in ("R1", "R2"):
        velocity = world.scan(robot, 2).velocity
        assert velocity == pytest.approx(factory.scan(robot, 2).velocity, abs=0.2)


def test_recorded_robots_fuse_as_the_simulated_ones_do(
    factory: FactoryWorld, recorded: Path
) -> None:
    world = open_world("bag", data=recorded)
    found = fuse_frame(world, 1, "R1", world.robots, "late").boxes
    expected = fuse_frame(factory, 1, "R1", factory.robots, "late").boxes
    assert len(expected) > 0
    assert np.allclose(found.centers, expected.centers, atol=0.01)


def test_there_is_no_ground_truth(recorded: Path) -> None:
    truth = open_world("bag", data=recorded).ground_truth(0)
    assert (len(truth.boxes), truth.ids, len(truth.visible_points)) == (0, (), 0)


def test_a_world_says_what_it_is(recorded: Path) -> None:
    said = repr(open_world("bag", data=recorded))
    assert said == f"BagWorld(R1, R2, R3; {FRAMES} frames at 10 Hz, detector factory)"


def test_frames_wrap_around_and_an_unknown_robot_is_named(recorded: Path) -> None:
    world = open_world("bag", data=recorded)
    again = world.scan("R1", FRAMES + 2)
    assert again.frame == 2
    assert np.array_equal(again.points, world.scan("R1", 2).points)
    with pytest.raises(WorldError, match="'R9' has no bag; there are R1, R2, R3"):
        world.scan("R9", 0)
    with pytest.raises(WorldError, match="'bag' needs the directory"):
        open_world("bag")


def taken(world: BagWorld, robot: str, frame: int) -> float:
    """When the scan that a frame shows was taken: its first point says so."""
    return float(world.scan(robot, frame).points[0, 0])


def test_robots_of_other_rates_and_offsets_share_one_clock(tmp_path: Path) -> None:
    plain_log(np.arange(0, 5, 0.1)).write(tmp_path / "R1")
    plain_log(np.arange(1.03, 4.5, 0.2)).write(tmp_path / "R2", "sqlite3")
    plain_log(np.arange(0.55, 7, 0.05)).write(tmp_path / "R3")
    world = BagWorld(tmp_path)
    assert world.rate_hz == 10.0
    assert world.start_ns == ns(1.03)
    assert world.frame_count == 1 + int((4.43 - 1.03) * 10 + 1e-6)
    for frame in range(world.frame_count):
        now = 1.03 + frame / 10
        for robot, begin, step in (("R1", 0, 0.1), ("R2", 1.03, 0.2), ("R3", 0.55, 0.05)):
            newest = begin + math.floor((now - begin) / step + 1e-6) * step
            assert taken(world, robot, frame) == pytest.approx(newest, abs=1e-5)
            # One metre a second, and the sensor 0.2 m before the base.
            assert world.pose(robot, frame).x == pytest.approx(newest + 0.2, abs=1e-5)


def test_a_scan_that_is_too_old_is_empty(tmp_path: Path) -> None:
    times = np.array([0, 0.1, 0.2, 1.5, 1.6])
    Log().scans(times).drive(np.arange(20) / 10).tf(0, MOUNT, static=True).write(tmp_path / "R1")
    plain_log(np.arange(17) / 10).write(tmp_path / "R2")
    world = BagWorld(tmp_path)
    seen = [len(world.scan("R1", frame).points) for frame in range(world.frame_count)]
    assert seen == [1] * 8 + [0] * 7 + [1] * 2
    # Without a scan, the robot is where it is at the frame.
    assert world.pose("R1", 7).x == pytest.approx(0.4)
    assert world.pose("R1", 12).x == pytest.approx(1.4)
    (tmp_path / "world.toml").write_text("max_scan_age_s = 0.15\nrate_hz = 20\n")
    world = BagWorld(tmp_path)
    assert world.frame_count == 33
    assert [len(world.scan("R1", frame).points) for frame in range(9)] == [1] * 8 + [0]


def test_the_pose_is_that_of_the_scans_own_time(tmp_path: Path) -> None:
    """Odometry at other times than scans, turning: between two samples lies half of the turn."""
    log = Log().scans([0.0, 0.25, 0.5])
    for time, yaw, pitch in ((0.0, 3.0, 0.0), (0.5, 3.4, 0.2)):
        pose = Pose(10 * time, 0, 0, pitch=pitch, yaw=yaw)
        log.add("/odom", ODOMETRY, ns(time), odometry(ns(time), pose, (10, 0, 0), (0, 0, 0.8)))
    log.tf(0, MOUNT, static=True).write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    matrix = world.pose("R1", 1).matrix()
    base = matrix @ np.linalg.inv(MOUNT["base_link", "lidar"].matrix())
    assert base[:3, 3] == pytest.approx((2.5, 0, 0))
    half = pose_of(base)
    assert half.heading == pytest.approx(3.2, abs=0.005)
    assert half.pitch == pytest.approx(0.1, abs=0.005)
    # The twist is the base's, in its own axes; the sensor 0.2 m before it swings with the turn.
    first = Pose(0, 0, 0, yaw=3.0).matrix()[:3, :3]
    assert world.scan("R1", 0).velocity == pytest.approx(tuple(first @ (10, 0.16, 0)))


def test_where_no_pose_is_near_nothing_is_seen(tmp_path: Path) -> None:
    times = np.arange(60) / 10
    driving = [*np.arange(11) / 10, *np.arange(50, 60) / 10]
    Log().scans(times).drive(driving).tf(0, MOUNT, static=True).write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    seen = [len(world.scan("R1", frame).points) for frame in range(world.frame_count)]
    assert seen == [1] * 21 + [0] * 19 + [1] * 20


def test_slow_corrections_of_tf_hold_between_them(tmp_path: Path) -> None:
    log = Log().scans(TIMES).tf(0, MOUNT, static=True)
    for time in TIMES:
        log.tf(time, {("odom", "base_link"): Pose(time, 0, 0)})
    log.tf(0.05, {("map", "odom"): Pose(100, 0, 0)}).write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    assert all(len(world.scan("R1", frame).points) for frame in range(world.frame_count))
    assert world.pose("R1", 10).x == pytest.approx(101.2)
    assert world.scan("R1", 10).velocity == pytest.approx((1, 0, 0))


@pytest.mark.parametrize("about", [{}, {("base_link", "wheel"): Pose(0, 1, 0)}])
def test_tf_may_begin_and_end_with_messages_about_other_frames(
    tmp_path: Path, about: dict[tuple[str, str], Pose]
) -> None:
    log = Log().scans(TIMES).tf(0, MOUNT, static=True).tf(-5.0, about)
    for time in TIMES:
        log.tf(time, {("odom", "base_link"): Pose(time, 0, 0)})
    log.tf(9.0, about).write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    assert world.frame_count == len(TIMES)
    assert world.pose("R1", 10).x == pytest.approx(1.2)


@pytest.mark.parametrize("frame", ["map", "R1/odom"])
def test_scans_in_a_frame_that_stays_are_refused(tmp_path: Path, frame: str) -> None:
    log = Log().scans(TIMES, frame=frame)
    for time in TIMES:
        log.tf(time, {(frame, "base_link"): Pose(time, 0, 0)})
    log.write(tmp_path / "R1")
    with pytest.raises(WorldError, match=f"/points.* are in {frame!r}, a frame that stays"):
        BagWorld(tmp_path)


def test_frames_with_a_robots_prefix_are_known(tmp_path: Path) -> None:
    log = Log().scans(TIMES, frame="/R1/lidar")
    log.tf(0, {("R1/base_link", "R1/lidar"): Pose(0, 0, 2)}, static=True)
    for time in TIMES:
        log.tf(time, {("/R1/odom", "/R1/base_link"): Pose(time, 0, 0)})
    log.write(tmp_path / "R1")
    assert BagWorld(tmp_path).pose("R1", 5).as_tuple() == pytest.approx((0.5, 0, 2, 0, 0, 0))


def test_a_robot_that_never_moves_needs_static_transforms_only(tmp_path: Path) -> None:
    log = Log().scans(TIMES).tf(0, {("map", "lidar"): Pose(5, 6, 7, yaw=1)}, static=True)
    log.write(tmp_path / "R1")
    scan = BagWorld(tmp_path).scan("R1", 3)
    assert scan.pose.as_tuple() == pytest.approx((5, 6, 7, 0, 0, 1))
    assert scan.velocity == (0, 0, 0)


def test_scans_without_a_stamp_were_taken_when_they_were_recorded(tmp_path: Path) -> None:
    log = Log().drive(np.arange(40) / 10, child="lidar")
    for time in TIMES:
        log.add("/points", CLOUD, ns(time), cloud(0, np.ones((1, 3)), "lidar"))
    log.write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    assert world.start_ns == START_NS + LATENCY_NS
    assert world.pose("R1", 5).x == pytest.approx(0.507)


def test_world_toml_places_sensor_and_origin_and_names_topics(tmp_path: Path) -> None:
    log = Log().scans(TIMES, topic="/front").scans(TIMES, np.ones((2, 3)), topic="/rear")
    log.drive(TIMES, topic="/wheels").drive(TIMES, 9.0, topic="/visual").write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text(
        """
        detector = "road"
        [robots.R1]
        points = "/rear"
        odometry = "/wheels"
        sensor = {x = -1, z = 2.0, yaw = 3.141592653589793}
        origin = {x = 10, y = 20, yaw = 1.5707963267948966}
        """
    )
    world = BagWorld(tmp_path)
    assert (world.detector, world.range_m) == ("road", 120.0)
    scan = world.scan("R1", 10)
    assert len(scan.points) == 2
    # One metre along the world's y from the origin, the sensor one metre behind.
    assert scan.pose.as_tuple() == pytest.approx((10, 20, 2, 0, 0, -math.pi / 2))
    assert scan.velocity == pytest.approx((0, 1, 0))
    ahead = transform(scan.pose.matrix(), np.array([[1.0, 0, 0]]))
    assert ahead[0] == pytest.approx((10, 19, 2), abs=1e-5)


def test_a_sensor_of_world_toml_takes_the_place_of_tfs(tmp_path: Path) -> None:
    log = Log().scans(TIMES).tf(0, MOUNT, static=True)
    for time in TIMES:
        log.tf(time, {("odom", "base_link"): Pose(time, 0, 0)})
    log.write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text("[robots.R1]\nsensor = {z = 3}\n")
    assert BagWorld(tmp_path).pose("R1", 5).as_tuple() == pytest.approx((0.5, 0, 3, 0, 0, 0))


def test_a_sensor_of_world_toml_is_on_a_base_that_stays_on_another_frame(tmp_path: Path) -> None:
    """As of many small robots: odometry moves `base_footprint`, and `base_link` stays on it."""
    log = Log().scans(TIMES).tf(0, {("base_footprint", "base_link"): Pose(0, 0, 1)}, static=True)
    for time in TIMES:
        log.tf(time, {("odom", "base_footprint"): Pose(time, 0, 0)})
    log.write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text("[robots.R1]\nsensor = {z = 3}\n")
    assert BagWorld(tmp_path).pose("R1", 5).as_tuple() == pytest.approx((0.5, 0, 4, 0, 0, 0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rate_hz = ", "world.toml cannot be read"),
        (
            "speed = 1",
            r"world.toml has the key 'speed'; allowed: detector, comm_range_m, rate_hz",
        ),
        ("detector = 'moon'", "detector = 'moon' in .*world.toml is not known; allowed: "),
        ("rate_hz = 0", "rate_hz = 0 in .*world.toml is not valid: Expected `float` > 0"),
        ("rate_hz = nan", "rate_hz = nan in .*world.toml is not valid"),
        ("max_scan_age_s = '1'", "max_scan_age_s = '1' in .* is not valid"),
        ("robots = 3", "robots = 3 in .* is not valid"),
        ("[robots.R7]", "world.toml names robot 'R7', which has no data; there are R1"),
        ("[robots.R1]\ntopic = 'a'", r"\[robots.R1\] of .* has the key 'topic'; allowed: points"),
        ("[robots.R1]\nsensor = {x = inf}", r"sensor = {'x': inf} in \[robots.R1\] .* not finite"),
        (
            "[robots.R1]\nsensor = {q = 1}",
            r"sensor = {'q': 1} in \[robots.R1\] .* unknown field `q`",
        ),
        ("[robots.R1]\npoints = '/odom'", "'/odom' of bag .*R1 is nav_msgs/msg/Odometry; world.to"),
        ("[robots.R1]\nodometry = '/x'", "'/x' of bag .*R1 is not there; .* there are /odom"),
    ],
)
def test_a_wrong_setting_is_named(tmp_path: Path, text: str, words: str) -> None:
    plain_log(TIMES).write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text(text)
    with pytest.raises(WorldError, match=words):
        BagWorld(tmp_path)


def looped() -> Log:
    log = Log().scans(TIMES)
    for time in TIMES:
        log.tf(time, {("base_link", "lidar"): Pose(1, 0, 0), ("lidar", "base_link"): Pose(1, 0, 0)})
    return log


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (Log().drive(TIMES), r"R1 has no sensor_msgs/msg/PointCloud2 .* it has /odom \(nav_msgs"),
        (Log().scans(TIMES), "R1 has neither nav_msgs/msg/Odometry nor tf2_msgs/msg/TFMessage"),
        (
            plain_log(TIMES).scans(TIMES, topic="/rear"),
            "several sensor_msgs/msg/PointCloud2 topics: /points, /rear; name one in world.toml",
        ),
        (
            plain_log(TIMES).drive(TIMES, topic="/visual"),
            "several nav_msgs/msg/Odometry topics: /odom, /visual; name one in world.toml",
        ),
        (Log().scans(TIMES).drive(TIMES), "where 'lidar', .* is on 'base_link', .* give the ro"),
        (
            Log().scans(TIMES).tf(0, MOUNT, static=True).tf(1, {("odom", "wheel"): Pose(0, 0, 0)}),
            "from none of map, odom to 'lidar', .* it has base_link -> lidar, odom -> wheel",
        ),
        (looped(), "from none of map, odom to 'lidar'"),
        (
            Log().scans(TIMES).drive(TIMES + 100, child="lidar"),
            r"scans and poses of bag .*R1 share no time: scans \(topic /points\) are stamped "
            r"1700000000.000 to 1700000002.900 s, poses 1700000100.000 to",
        ),
    ],
)  # fmt: skip
def test_a_bag_that_lacks_something_is_named(tmp_path: Path, log: Log, words: str) -> None:
    log.write(tmp_path / "R1")
    with pytest.raises(WorldError, match=words):
        BagWorld(tmp_path)


def test_bags_that_share_no_time_are_named(tmp_path: Path) -> None:
    plain_log(TIMES).write(tmp_path / "R1")
    plain_log(TIMES + 60).write(tmp_path / "R2")
    with pytest.raises(WorldError, match=r"share no time: R1 .*2.900 s; R2 17\d+60.000 to"):
        BagWorld(tmp_path)


def test_a_malformed_message_is_named_when_it_is_read(tmp_path: Path) -> None:
    log = plain_log(TIMES)
    wrong = cloud(ns(1.05), np.ones((4, 3)), "lidar")
    wrong.width = 5
    log.add("/points", CLOUD, ns(1.05), wrong).write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text("rate_hz = 20")
    world = BagWorld(tmp_path)
    assert len(world.scan("R1", 20).points) == 1
    with pytest.raises(
        WorldError, match=r"message 11 of topic /points of bag .*R1 is malformed: 1 r"
    ):
        world.scan("R1", 21)


@pytest.mark.parametrize("x", [math.nan, math.inf, 1e300])
def test_a_pose_that_is_none_is_named(tmp_path: Path, x: float) -> None:
    log = Log().scans(TIMES).drive(TIMES, child="lidar")
    log.add("/odom", ODOMETRY, ns(1), odometry(ns(1), Pose(x, 0, 0), child="lidar"))
    log.write(tmp_path / "R1")
    with pytest.raises(WorldError, match=r"'lidar' in 'odom' is at .(nan|inf|1e.300).*no place on"):
        BagWorld(tmp_path).scan("R1", 0)


def test_a_speed_that_is_none_is_no_speed(tmp_path: Path) -> None:
    log = Log().scans(TIMES)
    for time, speed in zip(TIMES, itertools.cycle((math.nan, 1e300))):
        message = odometry(ns(time), Pose(time, 0, 0), (speed, 0, 0), child="lidar")
        log.add("/odom", ODOMETRY, ns(time), message)
    log.write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    assert {world.scan("R1", frame).velocity for frame in (3, 4)} == {(0.0, 0.0, 0.0)}


def test_opening_reads_no_scan_and_few_poses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot opens every robot's bag, and asks for its own scans only."""
    for robot in ("R1", "R2"):
        plain_log(np.arange(600) / 10).write(tmp_path / robot)
    read: list[int | None] = []
    whole = McapFile.read

    def counted(file: McapFile, place: tuple[int, int], most: int | None = None) -> bytes:
        read.append(most)
        return whole(file, place, most)

    monkeypatch.setattr(McapFile, "read", counted)
    world = BagWorld(tmp_path)
    assert sum(most is None for most in read) < 20, "of all scans, only the stamps"
    read.clear()
    world.scan("R1", 300)
    assert 600 <= sum(most is None for most in read) < 620


def test_stamps_of_long_bags_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    times = np.arange(1200) / 10
    times[[500, 900]] = times[[900, 500]]  # recorded out of order
    plain_log(times).write(tmp_path / "data" / "R1")
    read: list[int | None] = []
    whole = McapFile.read

    def counted(file: McapFile, place: tuple[int, int], most: int | None = None) -> bytes:
        read.append(most)
        return whole(file, place, most)

    monkeypatch.setattr(McapFile, "read", counted)
    first = BagWorld(tmp_path / "data")
    assert len(read) > 1200
    read.clear()
    second = BagWorld(tmp_path / "data")
    assert len(read) < 200
    assert second.timings == first.timings
    assert first.timings[0].begin_s == pytest.approx(START_NS / 1e9)
    for frame in (499, 500, 501, 1199):
        assert np.array_equal(second.scan("R1", frame).points, first.scan("R1", frame).points)

    (kept,) = (tmp_path / "cache" / "coadapt" / "stamps").iterdir()
    kept.write_bytes(kept.read_bytes()[:-8])
    read.clear()
    assert BagWorld(tmp_path / "data").timings == first.timings, "a damaged file is made again"
    assert len(read) > 1200

    plain_log(np.arange(1200) / 5).write(tmp_path / "again" / "R1")
    shutil.rmtree(tmp_path / "data" / "R1")
    (tmp_path / "again" / "R1").rename(tmp_path / "data" / "R1")
    assert BagWorld(tmp_path / "data").rate_hz == 5, "another bag of that name is another bag"


def test_a_bag_opens_where_stamps_cannot_be_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("a file, no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    plain_log(np.arange(1000) / 10).write(tmp_path / "data" / "R1")
    assert BagWorld(tmp_path / "data").frame_count == 1000


def test_ap_says_that_bags_have_no_true_boxes(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ap", str(recorded), "--algorithm", "late"]) == 1
    assert "bags of 3 robots and does not say what was really there" in capsys.readouterr().err


def test_transforms_of_both_kinds_in_one_message_are_told_apart(tmp_path: Path) -> None:
    """What tf_static says of a frame holds, whatever tf says of others."""
    log = Log().scans(TIMES).tf(0, MOUNT, static=True)
    for time in TIMES:
        edges = {("odom", "base_link"): Pose(time, 0, 0), ("base_link", "arm"): Pose(0, time, 0)}
        log.add("/tf", "tf2_msgs/msg/TFMessage", ns(time), transforms(ns(time), edges))
    log.write(tmp_path / "R1")
    assert BagWorld(tmp_path).pose("R1", 10).x == pytest.approx(1.2)
