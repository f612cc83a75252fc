"""Known robots: what shows one of them is no detection, whatever else is near."""

from __future__ import annotations

import numpy as np
import pytest

from perception.detector import configuration
from perception.fusion.known import NEAR_M, KnownRobot, bodies, seen_at, without_known
from perception.types import Boxes
from swarm.body import Body
from swarm.geometry import Pose
from worlds.base import World, body_of
from worlds.cooperative.fusing import Disturbance, fuse_frame, known_robots
from worlds.factory.world import FactoryWorld
from worlds.road.world import RoadWorld

BODY = Body(label="robot", size=(0.9, 0.6, 1.26), center=(0.0, 0.0, -0.57))


def at(x: float, y: float, label: str = "robot", size: tuple[float, float] = (0.9, 0.6)) -> Boxes:
    return Boxes(
        centers=np.array([[x, y, 0.6]]),
        sizes=np.array([[*size, 1.2]]),
        headings=np.zeros(1),
        scores=np.array([0.8]),
        labels=(label,),
    )


def robot(x: float, y: float, age_s: float = 0.0, yaw: float = 0.0) -> KnownRobot:
    return KnownRobot("R2", BODY, Pose(x, y, 1.2, yaw=yaw).matrix(), age_s)


def test_a_box_of_its_own_class_beside_it_is_the_robot() -> None:
    assert len(without_known(at(5.4, 5.0), [robot(5.0, 5.0)])) == 0


def test_another_class_beside_it_is_an_object() -> None:
    beside = at(5.0, 5.0 + 0.3 + 0.25 + 0.02, "person", (0.5, 0.5))
    assert len(without_known(beside, [robot(5.0, 5.0)])) == 1


def test_whatever_overlaps_it_is_the_robot() -> None:
    assert len(without_known(at(5.2, 5.0, "forklift"), [robot(5.0, 5.0)])) == 0


def test_a_second_robot_that_no_beacon_tells_is_an_object() -> None:
    assert len(without_known(at(6.2, 5.0), [robot(5.0, 5.0)])) == 1


def test_an_old_beacon_reaches_as_far_as_the_robot_may_have_strayed() -> None:
    box = at(5.0 + NEAR_M + 0.5, 5.0)
    assert len(without_known(box, [robot(5.0, 5.0)])) == 1
    assert len(without_known(box, [robot(5.0, 5.0, age_s=0.9)])) == 0


def test_two_robots_in_one_place_take_one_box() -> None:
    both = [robot(5.0, 5.0), robot(5.1, 5.0)]
    assert len(without_known(at(5.0, 5.0), both)) == 0
    assert len(bodies(both)) == 2


def test_without_known_robots_or_boxes_nothing_changes() -> None:
    assert len(without_known(at(1, 1), [])) == 1
    assert len(without_known(Boxes.empty(), [robot(1, 1)])) == 0


@pytest.mark.parametrize("world", [FactoryWorld(robots=4, seed=5), RoadWorld(robots=2, seed=5)])
def test_a_world_s_robots_are_where_its_truth_has_them(world: World) -> None:
    truth = world.ground_truth(12)
    known = known_robots(world, 12, world.robots[0])
    assert [one.robot for one in known] == list(world.robots[1:])
    for one, box in zip(known, [one.box() for one in known], strict=True):
        place = truth.ids.index(one.robot)
        assert box.centers[0] == pytest.approx(truth.boxes.centers[place], abs=0.05)
        assert box.sizes[0] == pytest.approx(truth.boxes.sizes[place])
        assert box.labels[0] == truth.boxes.labels[place]


@pytest.mark.parametrize("algorithm", ["early", "late", "intermediate"])
def test_what_a_sender_sees_brings_it_to_its_place(algorithm: str) -> None:
    world, noise = FactoryWorld(robots=5, seed=1_830_001), Disturbance(pose_noise_m=0.4)
    off: dict[str, list[float]] = {"told": [], "seen": []}
    for frame in (20, 400, 800):
        told = known_robots(world, frame, "R1", noise.pose_noise_m)
        seen = fuse_frame(world, frame, "R1", ("R2", "R3", "R4"), algorithm, noise).known
        for before, after in zip(told, seen, strict=True):
            true = world.pose(after.robot, frame).matrix()
            if after.robot == "R5":
                assert np.array_equal(before.here_from_sensor, after.here_from_sensor)
                continue
            for name, one in (("told", before), ("seen", after)):
                off[name].append(float(np.hypot(*(one.here_from_sensor - true)[:2, 3])))
    assert np.median(off["seen"]) < 0.5 * np.median(off["told"])


def test_a_correction_moves_the_robot_it_is_for() -> None:
    step = Pose(1.0, 0.0, 0.0).matrix()
    moved = seen_at([robot(5.0, 5.0)], {"R2": step, "R9": step})
    assert moved[0].box().centers[0, :2] == pytest.approx([6.0, 5.0])
    stayed = seen_at([robot(5.0, 5.0)], {"R9": step})
    assert stayed[0].box().centers[0, :2] == pytest.approx([5.0, 5.0])


def test_a_world_that_does_not_say_has_the_usual_bodies_of_its_detector() -> None:
    class Plain:
        detector = "road"

    plain: World = Plain()  # type: ignore[assignment]
    assert body_of(plain, "R1") == configuration("road").usual_body
