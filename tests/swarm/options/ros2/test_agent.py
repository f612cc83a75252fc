"""Live robots in a swarm: real robot and ego processes, whose sensors speak as rmw_zenoh does."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from scipy.spatial import cKDTree

from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from robot_agent.settings import load_settings
from sensing.opening import open_world_of
from swarm import keyspace
from swarm.errors import RefusedError, SettingError
from swarm.geometry import Pose
from swarm.messages import Beacon, Observation, ObservationRequest
from swarm.process import Clock
from swarm.session import Session
from tests.support.ego_swarm import TIMEOUT_S, Swarm, hear, stop, swarm_of, until
from tests.support.robot_worlds import ChosenWorld, room
from tests.support.robot_worlds import Robot as Agent
from tests.support.ros2_robot import Robot
from worlds.base import Scan


@pytest.fixture
def swarm(tmp_path: Path) -> Iterator[Swarm]:
    """A swarm whose router is the robots' router, too."""
    with swarm_of({"COADAPT_WORLD": "ros2", "COADAPT_ALGORITHMS": "early,late"}, tmp_path) as made:
        made.router()
        yield made


def address(swarm: Swarm, domain: int) -> str:
    return (
        f"ros2://127.0.0.1:{swarm.port}/{domain}?points=/points&odom=/odom&sensor=0,0,1&max_age=5"
    )


def fetch(session: Session, robot: str) -> Observation:
    request = ObservationRequest(
        ego="E", request=1, algorithm="early", capture_ns=0, max_error_m=0.05, keep_ground=True
    )
    key = keyspace.observation("test", robot)
    return session.ask(key, request, Observation, timeout_s=5).result(TIMEOUT_S).message


def refusal(session: Session, robot: str) -> str:
    try:
        fetch(session, robot)
    except RefusedError as error:
        return str(error)
    return ""


def test_a_live_robot_tells_and_answers_while_it_is_live(swarm: Swarm) -> None:
    session = swarm.session()
    beacons = hear(session, keyspace.beacon("test", "R1"), Beacon)
    swarm.robot("R1", world_data=address(swarm, 3))
    until(lambda: session.alive() == ("R1",), "the robot's process is there")
    assert "robot R1 has no frame yet" in refusal(session, "R1")
    points = room()
    with Robot(swarm.port, 3) as robot:
        robot.drive(Pose(4, 5, 0), speed=0.5)
        going = robot.scans(points, 0.1)
        beacon = beacons.until(lambda told: True)
        assert beacon.pose[1:3] == pytest.approx((5, 1))
        assert beacon.velocity == pytest.approx((0.5, 0, 0))
        got = fetch(session, "R1")
        decoded = decode_points(take_outline(got.payload)[0])
        assert len(decoded) == len(points)
        assert cKDTree(decoded).query(points)[0].max() <= 0.05
        assert abs(got.capture_ns - robot.now_ns()) < TIMEOUT_S * 1e9

        # Silence: nothing that was seen before is told or sent as if it were now.
        going.set()
        until(lambda: "has no frame yet" in refusal(session, "R1"), "the robot forgets")
        resumed_ns = robot.now_ns()
        robot.scans(points, 0.1)
        again = beacons.until(lambda told: told.capture_ns > resumed_ns)
        before = next(told for told in beacons.all if told.seq == again.seq - 1)
        assert before.capture_ns < resumed_ns
        assert again.pose[0] > beacon.pose[0]
        assert fetch(session, "R1").frame >= again.frame
    events = [json.loads(line) for line in swarm.logs().splitlines() if "ros2_" in line]
    silent = [one for one in events if one.get("kind") == "silent"]
    assert silent
    assert "topic /points has been silent for" in silent[0]["error"]


@pytest.mark.slow
def test_an_ego_fuses_its_own_live_robot_with_another(swarm: Swarm) -> None:
    """Two robots in one room, each with its own ROS domain and a map of its own."""
    session = swarm.session()
    detections = swarm.detections(session, "R1")
    with Robot(swarm.port, 3) as first, Robot(swarm.port, 4, clock_s=900.0) as second:
        for robot, x in ((first, 0.0), (second, 3.0)):
            robot.drive(Pose(x, 0, 0))
            robot.scans(room(int(x)), 0.1)
        how = {"policy": "static-early", "deadline_s": "1", "period_s": "0.3"}
        swarm.ego(ego="R1", world_data=address(swarm, 3), **how)
        swarm.robot("R2", world_data=address(swarm, 4) + "&origin=0,1,0")
        fused = detections.until(lambda told: "R2" in told.participants)
        assert fused.participants == ("R1", "R2")
        assert fused.bytes["R2"] > 0
        assert abs(fused.capture_ns - first.now_ns()) < 5e9


def test_a_scan_of_a_slow_sensor_is_taken_once() -> None:
    """Frames come more often than scans."""

    class Slow(ChosenWorld):
        def scan(self, robot: str, frame: int) -> Scan:
            taken_ns = time.time_ns() // 400_000_000 * 400_000_000
            return replace(super().scan(robot, frame), captured_ns=taken_ns)

    robot = Agent(Slow(), clock=Clock(100.0))
    captured = set()
    for _ in range(8):
        robot.sense()
        beacon = robot.agent.beacon()
        assert beacon is not None
        captured.add(beacon.capture_ns)
    assert robot.value("coadapt_robot_scans_total", robot="R1") == len(captured) < 8
    assert all((told - 100_000_000_000) % 400_000_000 == 0 for told in captured)


def test_a_live_robot_is_one_process_robot(swarm: Swarm) -> None:
    process = swarm.robot("R1", "R2", world_data=address(swarm, 3))
    assert process.wait(TIMEOUT_S) == 1
    told = "names R2, which world 'ros2' does not have; allowed: R1"
    assert told in swarm.logs()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("", r"needs COADAPT_WORLD_DATA, the robot's address: ros2://HOST"),
        ("/bags", "address '/bags' is not valid; it must be ros2://HOST"),
    ],
)
def test_a_missing_address_is_named(data: str, words: str) -> None:
    values = {"COADAPT_WORLD": "ros2", "COADAPT_ROBOTS": "R1", "COADAPT_WORLD_DATA": data}
    with (
        pytest.raises(SettingError, match=words),
        open_world_of(load_settings(values), "robot_agent", "R1"),
    ):
        pytest.fail("it opened")


def test_a_process_that_ends_leaves_the_robots_network(swarm: Swarm) -> None:
    data = address(swarm, 3)
    values = {"COADAPT_WORLD": "ros2", "COADAPT_ROBOTS": "R1", "COADAPT_WORLD_DATA": data}
    with Robot(swarm.port, 3) as robot:
        with open_world_of(load_settings(values), "robot_agent", "R1"):
            until(lambda: robot.nodes() == ["coadapt_robot_agent_R1"], "the node is there")
        until(lambda: robot.nodes() == [], "the node is gone")


@pytest.mark.slow
def test_the_processes_of_a_robot_have_names_of_their_own_and_leave_it(swarm: Swarm) -> None:
    names = ["coadapt_ego_agent_R1", "coadapt_robot_agent_R1"]
    agent = swarm.robot("R1", world_data=address(swarm, 3))
    ego = swarm.ego(ego="R1", world_data=address(swarm, 3))
    with Robot(swarm.port, 3) as robot:
        until(lambda: robot.nodes() == names, "both nodes are there")
        assert [stop(process) for process in (agent, ego)] == [0, 0]
        until(lambda: robot.nodes() == [], "both nodes are gone")
    assert swarm.logs().count('"ros2_down"') == 2
