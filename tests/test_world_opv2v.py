"""The OPV2V reader, on the real sample and on broken directories."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from swarm.errors import WorldError
from swarm.geometry import transform
from worlds.opv2v import Opv2vWorld, points_in_box


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1, 2]", "is not a mapping"),
        ("lidar_pose: [1, 2", "cannot be read"),
        ("lidar_pose: [1, 2]", "no valid lidar_pose"),
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
