"""The OPV2V reader, on the real sample and on broken directories."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarm.errors import WorldError
from swarm.geometry import transform
from worlds.opv2v.world import Opv2vWorld, points_in_box
from worlds.registry import open_world


@pytest.fixture(scope="module")
def world(opv2v_dir: Path) -> Opv2vWorld:
    return Opv2vWorld(opv2v_dir)


def inside(world: Opv2vWorld, mirrored: bool) -> int:
    """Points of all scans of frame 0 in boxes; `mirrored` leaves the headings left-handed."""
    truth = world.ground_truth(0)
    boxes = truth.boxes
    if mirrored:
        boxes = dataclasses.replace(boxes, headings=-boxes.headings)
    total = 0
    for robot in world.robots:
        scan = world.scan(robot, 0)
        points = transform(scan.pose.matrix(), scan.points)
        total += sum(int(points_in_box(points, boxes, i).sum()) for i in range(len(boxes)))
    return total


def test_points_lie_inside_their_boxes_only_in_the_converted_frame(world: Opv2vWorld) -> None:
    truth = world.ground_truth(0)
    assert inside(world, mirrored=False) == truth.visible_points.sum()
    assert inside(world, mirrored=True) < 0.8 * truth.visible_points.sum()


def test_both_recording_vehicles_appear_and_see_each_other(world: Opv2vWorld) -> None:
    assert world.robots == ("302", "311")
    truth = world.ground_truth(0)
    for robot in world.robots:
        index = truth.ids.index(robot)
        pose = world.pose(robot, 0)
        assert np.hypot(*(truth.boxes.centers[index, :2] - (pose.x, pose.y))) < 1.0
        assert truth.visible_points[index] > 100


def test_the_ground_lies_level_below_the_sensor(world: Opv2vWorld) -> None:
    scan = world.scan("302", 0)
    points = transform(scan.pose.matrix(), scan.points)
    near = np.hypot(scan.points[:, 0], scan.points[:, 1]) < 10
    low = np.sort(points[near, 2])[: near.sum() // 2]
    assert np.abs(np.median(low)) < 0.3


def test_velocity_agrees_with_the_recorded_speed(world: Opv2vWorld) -> None:
    speeds = [np.hypot(*world.scan("302", f).velocity[:2]) for f in range(world.frame_count)]
    # The first frame of the sample says 11.6 km/h; the vehicle then speeds up.
    assert speeds[0] == pytest.approx(11.6 / 3.6, rel=0.1)
    assert max(speeds) < 15


def test_frames_wrap_around_and_are_found_by_name(world: Opv2vWorld) -> None:
    assert world.frame_count == 16
    assert np.array_equal(world.scan("311", 3).points, world.scan("311", 19).points)
    assert world.frame_index("006226") == world.frame_index("3") == 3
    with pytest.raises(WorldError, match="'006221' is not in"):
        world.frame_index("006221")


def test_a_parent_directory_with_one_scenario_will_do(opv2v_dir: Path) -> None:
    assert Opv2vWorld(opv2v_dir.parent).frame_names == Opv2vWorld(opv2v_dir).frame_names


def test_an_unknown_robot_is_named(world: Opv2vWorld) -> None:
    with pytest.raises(WorldError, match=r"robot 'R9' is not in .* it has 302, 311"):
        world.scan("R9", 0)


def test_unreadable_directories_are_named(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="not a readable directory"):
        Opv2vWorld(tmp_path / "nowhere")
    with pytest.raises(WorldError, match="holds 0 OPV2V scenarios"):
        Opv2vWorld(tmp_path)
    (tmp_path / "data_protocol.yaml").write_text("{}")
    with pytest.raises(WorldError, match="has no <vehicle>/<frame>"):
        Opv2vWorld(tmp_path)


def write_scenario(directory: Path, *files: str) -> Path:
    """A scenario of empty files."""
    for name in ("data_protocol.yaml", *files):
        path = directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return directory


@pytest.mark.parametrize("gone", ["2/000002.pcd", "2/000002.yaml", "1/000000.pcd"])
def test_a_frame_that_one_vehicle_lacks_is_named(tmp_path: Path, gone: str) -> None:
    both = [f"{v}/00000{n}.{kind}" for v in (1, 2) for n in (0, 2) for kind in ("pcd", "yaml")]
    write_scenario(tmp_path, *(name for name in both if name != gone))
    with pytest.raises(WorldError, match=f"vehicle {gone[0]} of scenario .* lacks {gone[2:]}"):
        Opv2vWorld(tmp_path)


def test_two_scenarios_in_one_directory_must_be_told_apart(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_scenario(tmp_path / name, "1/000000.pcd", "1/000000.yaml")
    with pytest.raises(WorldError, match="holds 2 OPV2V scenarios"):
        Opv2vWorld(tmp_path)
    assert Opv2vWorld(tmp_path / "a").robots == ("1",)


def test_a_roadside_unit_is_no_robot(tmp_path: Path) -> None:
    files = [f"{v}/000000.{kind}" for v in (-1, 7) for kind in ("pcd", "yaml")]
    assert Opv2vWorld(write_scenario(tmp_path, *files)).robots == ("7",)


def test_scans_kept_on_disk_are_those_of_the_file(opv2v_dir: Path, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario", "302/006220.pcd", "302/006220.yaml")
    for name in ("302/006220.pcd", "302/006220.yaml"):
        shutil.copy(opv2v_dir / name, scenario / name)
    cache = tmp_path / "cache"
    expected = Opv2vWorld(scenario).scan("302", 0).points
    for _ in range(2):
        kept = open_world("opv2v", data=scenario, cache=cache).scan("302", 0).points
        assert np.array_equal(kept, expected)
        assert len(list(cache.iterdir())) == 1
    frame = scenario / "302" / "006220.pcd"
    shutil.copy(opv2v_dir / "311" / "006220.pcd", frame)
    assert not np.array_equal(Opv2vWorld(scenario, cache).scan("302", 0).points, expected)


def test_worlds_are_opened_by_name(opv2v_dir: Path) -> None:
    assert open_world("opv2v", data=opv2v_dir).robots == ("302", "311")
    with pytest.raises(WorldError, match="needs the directory"):
        open_world("opv2v")
    with pytest.raises(WorldError, match="'moon' is not known; allowed: bag, factory, opv2v"):
        open_world("moon")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1, 2]", "is not a mapping"),
        ("lidar_pose: [1, 2", "cannot be read"),
        ("lidar_pose: [1, 2]", "no valid lidar_pose"),
        ("lidar_pose: [1, 2, 3, .nan, 0, 0]", "no valid lidar_pose.*not finite"),
        ("vehicles: {}", "no valid lidar_pose"),
    ],
)
def test_a_malformed_frame_description_is_named(
    opv2v_dir: Path, tmp_path: Path, text: str, words: str
) -> None:
    shutil.copy(opv2v_dir / "data_protocol.yaml", tmp_path)
    (tmp_path / "302").mkdir()
    shutil.copy(opv2v_dir / "302" / "006220.pcd", tmp_path / "302")
    (tmp_path / "302" / "006220.yaml").write_text(text)
    with pytest.raises(WorldError, match=words):
        Opv2vWorld(tmp_path).scan("302", 0)


VEHICLE = {"location": [0, 0, 0], "center": [0, 0, 0], "extent": [1, 1, 1], "angle": [0, 0, 0]}


@pytest.mark.parametrize(
    "vehicles",
    [
        {7: VEHICLE | {"extent": [1, 2]}},
        {7: VEHICLE | {"angle": "north"}},
        {7: VEHICLE | {"center": None}},
        {7: "a car"},
        ["a car"],
    ],
)
def test_a_malformed_vehicle_is_named(opv2v_dir: Path, tmp_path: Path, vehicles: object) -> None:
    shutil.copy(opv2v_dir / "data_protocol.yaml", tmp_path)
    (tmp_path / "302").mkdir()
    shutil.copy(opv2v_dir / "302" / "006220.pcd", tmp_path / "302")
    facts = {"lidar_pose": [0] * 6, "vehicles": vehicles}
    (tmp_path / "302" / "006220.yaml").write_text(yaml.safe_dump(facts))
    with pytest.raises(WorldError, match="malformed vehicle"):
        Opv2vWorld(tmp_path).ground_truth(0)


def test_a_scan_that_no_vehicle_describes_is_no_frame(tmp_path: Path) -> None:
    both = [f"{v}/00000{n}.{kind}" for v in (1, 2) for n in (0, 2) for kind in ("pcd", "yaml")]
    write_scenario(tmp_path, *both, "1/000004.pcd", "2/000004.pcd")
    assert Opv2vWorld(tmp_path).frame_names == ("000000", "000002")
