"""Folders of plain scans as a world: points and poses come back, and mistakes are named."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from coadapt.main import main
from swarm.errors import WorldError
from swarm.geometry import Pose, invert
from tests.support.world_bags import ROAD_SEED
from worlds.base import comm_range_of
from worlds.check import check
from worlds.cooperative.fusing import fuse_frame
from worlds.plain.world import ScansWorld
from worlds.registry import find_kind, open_world
from worlds.road.world import RoadWorld

FRAMES = 4
POSES = [Pose(1.0 * k, 2.0, 0.5, 0.01, -0.02, 0.1 * k) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def cars() -> RoadWorld:
    return RoadWorld(robots=2, seed=ROAD_SEED)


@pytest.fixture(scope="module")
def lot(cars: RoadWorld, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """KITTI's binary scans of R1 beside their poses, and PLY-free arrays of R2 in a folder of
    their own."""
    folder = tmp_path_factory.mktemp("lot")
    for robot, inside in (("R1", "."), ("R2", "velodyne")):
        (folder / robot / inside).mkdir(parents=True)
        rows = []
        for frame in range(FRAMES):
            scan = cars.scan(robot, frame)
            path = folder / robot / inside / f"{frame + 8}"
            four = np.column_stack([scan.points, np.zeros(len(scan.points))]).astype("<f4")
            if robot == "R1":
                four.tofile(path.with_suffix(".bin"))
            else:
                np.save(path.with_suffix(".npy"), four)
            rows.append(scan.pose.matrix()[:3].ravel())
        np.savetxt(folder / robot / "poses.txt", rows)
    return folder


@pytest.mark.stumble(
    "a folder of .bin scans cannot be fused", command="make up WORLD=scans DATA=dir"
)
def test_plain_scans_of_cars_come_back_and_fuse(cars: RoadWorld, lot: Path) -> None:
    kind, words = find_kind(lot)
    assert (kind.name, words) == ("scans", "plain scans of 2 robots")
    world = open_world(kind.name, data=lot)
    assert (world.robots, world.frame_count, world.rate_hz) == (("R1", "R2"), FRAMES, 10.0)
    assert (world.detector, comm_range_of(world)) == ("road", 70.0)
    for robot in world.robots:
        for frame in (0, FRAMES - 1, FRAMES):
            mine, theirs = world.scan(robot, frame), cars.scan(robot, frame % FRAMES)
            assert np.array_equal(mine.points, theirs.points)
            assert mine.pose.as_tuple() == pytest.approx(theirs.pose.as_tuple(), abs=1e-9)
            assert mine.velocity == pytest.approx(theirs.velocity, abs=0.3)
    assert len(world.ground_truth(0).boxes) == 0
    ours = fuse_frame(world, 1, "R1", ["R2"], "late")
    assert len(ours.boxes) == len(fuse_frame(cars, 1, "R1", ["R2"], "late").boxes) > 3


def one_robot(folder: Path, scans: int = FRAMES) -> Path:
    """A robot's folder with scans of one point, whose x is the scan's number."""
    (folder / "car").mkdir()
    for number in range(scans):
        np.save(folder / "car" / f"{number}.npy", np.array([[number, 1, 1]]))
    return folder / "car"


def csv_of(columns: str, rows: list[list[float]]) -> str:
    return "\n".join([columns, *(",".join(map(str, row)) for row in rows)]) + "\n"


def quaternion(pose: Pose) -> list[float]:
    cr, sr = math.cos(pose.roll / 2), math.sin(pose.roll / 2)
    cp, sp = math.cos(pose.pitch / 2), math.sin(pose.pitch / 2)
    cy, sy = math.cos(pose.yaw / 2), math.sin(pose.yaw / 2)
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]


@pytest.mark.parametrize("form", ["txt", "csv", "quaternions", "12", "3x4", "4x4", "6"])
def test_poses_are_read_in_every_form(tmp_path: Path, form: str) -> None:
    car = one_robot(tmp_path)
    matrices = np.array([pose.matrix() for pose in POSES])
    arrays = {
        "12": matrices[:, :3].reshape(-1, 12),
        "3x4": matrices[:, :3],
        "4x4": matrices,
        "6": np.array([pose.as_tuple() for pose in POSES]),
    }
    if form == "txt":
        np.savetxt(car / "poses.txt", matrices[:, :3].reshape(-1, 12))
    elif form == "csv":
        rows = [[0.1 * k, *pose.as_tuple()] for k, pose in enumerate(POSES)]
        (car / "poses.csv").write_text(csv_of("time, x, y, z, roll, pitch, yaw", rows))
    elif form == "quaternions":
        rows = [[pose.x, pose.y, pose.z, *quaternion(pose)] for pose in POSES]
        (car / "poses.csv").write_text(csv_of("x,y,z,qx,qy,qz,qw", rows))
    else:
        np.save(car / "poses.npy", arrays[form])
    world = ScansWorld(tmp_path)
    for frame, pose in enumerate(POSES):
        assert world.pose("car", frame).as_tuple() == pytest.approx(pose.as_tuple(), abs=1e-6)
        assert world.scan("car", frame).points[0, 0] == frame


def test_kittis_poses_are_of_its_camera_where_it_says_so(tmp_path: Path) -> None:
    car = one_robot(tmp_path)
    camera = np.array([[0, -1, 0, 0.1], [0, 0, -1, -0.2], [1, 0, 0, -0.3], [0, 0, 0, 1.0]])
    start = invert(POSES[0].matrix())
    rows = [(camera @ start @ pose.matrix() @ invert(camera))[:3].reshape(12) for pose in POSES]
    np.savetxt(car / "poses.txt", rows)
    numbers = " ".join(str(value) for value in camera[:3].reshape(12))
    (car / "calib.txt").write_text(f"P0: 1 2 3\nTr: {numbers}\n")
    world = ScansWorld(tmp_path)
    for frame, pose in enumerate(POSES):
        expected = start @ pose.matrix()
        assert np.allclose(world.pose("car", frame).matrix(), expected, atol=1e-6)


def test_world_toml_places_robots_and_names_rate_range_and_detector(tmp_path: Path) -> None:
    one_robot(tmp_path)
    (tmp_path / "world.toml").write_text(
        'detector = "road"\nrate_hz = 5\ncomm_range_m = 90\n'
        "[robots.car]\norigin = {x = 3.0, yaw = 0.5}\nfirst = 1\n"
    )
    world = ScansWorld(tmp_path)
    assert (world.detector, world.rate_hz, comm_range_of(world)) == ("road", 5.0, 90.0)
    assert world.pose("car", 2) == Pose(3.0, 0.0, 0.0, yaw=0.5)
    assert world.frame_count == FRAMES - 1
    assert world.scan("car", 0).points[0, 0] == 1


def test_a_world_says_what_it_is(lot: Path) -> None:
    said = repr(ScansWorld(lot))
    assert said == f"ScansWorld(R1, R2; {FRAMES} frames at 10 Hz, detector road)"


def test_scans_that_another_robot_lacks_are_told(lot: Path, tmp_path: Path) -> None:
    for robot in ("R1", "R2"):
        (tmp_path / robot).mkdir()
        many = FRAMES if robot == "R1" else 2
        for number in range(many):
            np.save(tmp_path / robot / f"{number}.npy", np.ones((1, 3)))
        np.save(tmp_path / robot / "poses.npy", np.tile(np.eye(4), (many, 1, 1)))
    world = ScansWorld(tmp_path)
    assert world.frame_count == 2
    assert world.notes[0].startswith("R1 has 4 scans, of which the first 2 are shown")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("", "", r"needs poses.txt, poses.csv, poses.npy, or, .*origin in \[robots.car\]"),
        ("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n", "has 1 poses for 4 scans"),
        ("poses.txt", "1 0 0 0\n", r"shape \(1, 4\); allowed: \(N, 12\)"),
        ("poses.txt", "1 0 0 0 0 1 0 0 0 0 2 0\n" * 4, "row 1 of poses .* is no pose"),
        ("poses.txt", "1 0 0 nan 0 1 0 0 0 0 1 0\n" * 4, "row 1 of poses .* is no pose"),
        ("poses.txt", "one two\n", "cannot be read"),
        ("poses.txt", "", "has none"),
        ("poses.csv", "x,y\n1,2\n", r"columns \['x', 'y'\]; needed: x, y, z, and yaw"),
        ("poses.csv", "x,y,z,yaw\n1,2,3\n", "line 2"),
        ("poses.csv", "x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,0\n", "no unit quaternion"),
        ("poses.npy", "nothing", "cannot be read"),
    ],
)
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_wrong_poses_are_named(tmp_path: Path, name: str, text: str, words: str) -> None:
    car = one_robot(tmp_path)
    if name:
        (car / name).write_text(text)
    with pytest.raises(WorldError, match=words) as error:
        ScansWorld(tmp_path)
    assert str(car) in str(error.value)


def test_two_files_of_poses_are_one_too_many(tmp_path: Path) -> None:
    car = one_robot(tmp_path)
    (car / "poses.txt").write_text("")
    (car / "poses.csv").write_text("")
    with pytest.raises(WorldError, match=r"several files of poses: poses\.txt, poses\.csv"):
        ScansWorld(tmp_path)


def test_a_folder_must_hold_one_folder_a_robot(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="holds no folder with scans"):
        ScansWorld(tmp_path)
    np.save(tmp_path / "0.npy", np.ones((1, 3)))
    with pytest.raises(WorldError, match="put them into one folder a robot"):
        find_kind(tmp_path)
    one_robot(tmp_path).rename(tmp_path / "my car")
    with pytest.raises(WorldError, match="robot 'my car', which is not allowed"):
        ScansWorld(tmp_path)
    with pytest.raises(WorldError, match="is not a readable directory"):
        ScansWorld(tmp_path / "none")


def test_a_robot_that_is_not_there_is_named(lot: Path) -> None:
    with pytest.raises(WorldError, match="robot 'R9' has no scans; there are R1, R2"):
        open_world("scans", data=lot).scan("R9", 0)


def timed(folder: Path, robot: str, times: list[float], ahead_s: float = 0.0) -> None:
    """A robot whose scans and poses say when they were taken, by a clock that may be ahead."""
    (folder / robot).mkdir()
    for number, time in enumerate(times):
        np.save(folder / robot / f"{number}.npy", np.array([[time, 1, 1]]))
    rows = [[time, 0, 0, 0, 0, 0] for time in times]
    np.save(folder / robot / "poses.npy", np.array(rows))
    (folder / robot / "times.txt").write_text("".join(f"{time + ahead_s}\n" for time in times))


def test_scans_with_times_are_shown_by_them(tmp_path: Path) -> None:
    timed(tmp_path, "R1", [k / 10 for k in range(1, 31)])
    timed(tmp_path, "R2", [0.52 + k / 5 for k in range(12)])
    (tmp_path / "world.toml").write_text("rate_hz = 10\n")
    world = ScansWorld(tmp_path)
    assert world.frame_count == 1 + 22
    for frame in range(world.frame_count):
        now = 0.52 + frame / 10
        first, second = (world.scan(robot, frame) for robot in ("R1", "R2"))
        assert first.points[0, 0] == pytest.approx(math.floor(now * 10 + 1e-9) / 10)
        assert 0 <= now - second.points[0, 0] < 0.2 + 1e-6
        assert second.pose.x == pytest.approx(float(second.points[0, 0]))
    assert world.scan("R1", 5).velocity == pytest.approx((1, 0, 0))
    assert [one.rate_hz for one in world.timings] == pytest.approx([10, 5])
    assert world.notes == ()


def test_scans_that_are_too_old_are_not_shown_and_lost_ones_told(tmp_path: Path) -> None:
    timed(tmp_path, "R1", [k / 10 for k in range(30)])
    timed(tmp_path, "R2", [k / 10 for k in range(30) if not 10 < k < 20])
    world = ScansWorld(tmp_path)
    seen = [bool(len(world.scan("R2", frame).points)) for frame in range(world.frame_count)]
    assert seen == [True] * 16 + [False] * 4 + [True] * 10
    assert world.notes == ("R2 lacks 9 scans between its 21",)


def test_the_velocity_is_that_between_scans_whatever_frames_show(tmp_path: Path) -> None:
    timed(tmp_path, "R1", [0.1 * k + (0.02 if k % 2 else 0.0) for k in range(20)])
    (tmp_path / "world.toml").write_text("rate_hz = 10\n")
    world = ScansWorld(tmp_path)
    shown = [float(world.scan("R1", frame).points[0, 0]) for frame in range(world.frame_count)]
    assert len(set(shown)) < len(shown), "frames show scans twice"
    for frame in range(world.frame_count):
        assert world.scan("R1", frame).velocity == pytest.approx((1, 0, 0))


def test_the_last_scan_moves_as_the_one_before_and_a_single_one_not_at_all(tmp_path: Path) -> None:
    timed(tmp_path, "R1", [0.0, 0.1, 0.2])
    timed(tmp_path, "R2", [0.0])
    (tmp_path / "world.toml").write_text("rate_hz = 10\n")
    world = ScansWorld(tmp_path)
    assert world.scan("R1", 0).velocity == pytest.approx((1, 0, 0))
    assert world.scan("R2", 0).velocity == (0.0, 0.0, 0.0)


def slow(folder: Path) -> None:
    """Two robots at 1 Hz, the second 0.6 s after the first."""
    timed(folder, "R1", [float(k) for k in range(20)])
    timed(folder, "R2", [k + 0.6 for k in range(20)])


def test_slow_robots_out_of_step_are_shown_and_no_clock_is_blamed(tmp_path: Path) -> None:
    slow(tmp_path)
    world = ScansWorld(tmp_path)
    for robot in world.robots:
        assert all(len(world.scan(robot, k).points) for k in range(world.frame_count))
    assert world.notes == ()
    assert check(world).skew is None


def test_world_toml_says_how_old_a_scan_may_be(tmp_path: Path) -> None:
    slow(tmp_path)
    (tmp_path / "world.toml").write_text("max_scan_age_s = 0.3\n")
    world = ScansWorld(tmp_path)
    assert [len(world.scan("R1", k).points) for k in range(world.frame_count)] == [0] * 19
    assert all(len(world.scan("R2", k).points) for k in range(world.frame_count))
    (tmp_path / "world.toml").write_text("max_scan_age_s = 0\n")
    with pytest.raises(WorldError, match=r"max_scan_age_s = 0 in .* is not valid"):
        ScansWorld(tmp_path)


def test_a_clock_is_mended_as_the_note_and_the_check_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = [k / 10 for k in range(30)]
    timed(tmp_path, "R1", times)
    timed(tmp_path, "R2", times, ahead_s=1.0)
    main(["worlds", "check", str(tmp_path)])
    assert "R2 may be 1.00 s ahead (clock_offset_s in world.toml)" in capsys.readouterr().out
    (note,) = ScansWorld(tmp_path).notes
    (asked,) = re.findall(r"clock_offset_s = [\d.]+", note)
    (tmp_path / "world.toml").write_text(f"[robots.R2]\n{asked}\n")
    world = ScansWorld(tmp_path)
    assert (world.frame_count, world.notes, check(world).skew) == (30, (), None)
    for frame in range(30):
        assert world.scan("R2", frame).points[0, 0] == world.scan("R1", frame).points[0, 0]


def test_a_clock_without_times_is_named(tmp_path: Path) -> None:
    one_robot(tmp_path)
    (tmp_path / "world.toml").write_text("[robots.car]\norigin = {}\nclock_offset_s = 1\n")
    with pytest.raises(WorldError, match=r"clock_offset_s in \[robots.car\] .* needs .*times\.txt"):
        ScansWorld(tmp_path)


def test_a_damaged_first_scan_is_told_when_a_frame_shows_it(lot: Path, tmp_path: Path) -> None:
    shutil.copytree(lot, tmp_path / "lot")
    (tmp_path / "lot" / "R1" / "8.bin").write_bytes(b"cut")
    world = ScansWorld(tmp_path / "lot")
    assert world.detector == "road"
    with pytest.raises(WorldError, match=r"8\.bin"):
        world.scan("R1", 0)
    assert len(world.scan("R1", 1).points)


def test_times_that_may_be_of_clocks_apart_are_told(tmp_path: Path) -> None:
    timed(tmp_path, "R1", [k / 10 for k in range(30)])
    timed(tmp_path, "R2", [1 + k / 10 for k in range(30)])
    world = ScansWorld(tmp_path)
    assert "the clock of R2 is 1.000 s ahead" in world.notes[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.1\n", "has 1 times for 2 scans"),
        ("0.1\n0.1\n", "seconds that ascend"),
        ("0.1\nnan\n", "seconds that ascend"),
        ("0.1\nsoon\n", r"times\.txt cannot be read"),
        ("100\n101\n", "share no time: R1 0.000 to 0.100 s; R2 100.000"),
        (None, r"has times\.txt for R1, and none for R2"),
    ],
)
def test_wrong_times_are_named(tmp_path: Path, text: str | None, words: str) -> None:
    timed(tmp_path, "R1", [0.0, 0.1])
    timed(tmp_path, "R2", [0.0, 0.1])
    if text is None:
        (tmp_path / "R2" / "times.txt").unlink()
    else:
        (tmp_path / "R2" / "times.txt").write_text(text)
    with pytest.raises(WorldError, match=words):
        ScansWorld(tmp_path)
