"""The robot process on a real router: beacons, scenes, observations, signals and refusals."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import CollectorRegistry
from scipy.spatial import cKDTree

from perception.codec.boxes import decode_boxes
from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from perception.fusion.algorithms.late import SENT_BOXES, SENT_SCORE
from perception.fusion.base import EncodeOptions
from perception.fusion.detectors import detector_backend, shared_finder
from robot_agent.__main__ import run
from robot_agent.duty import Duty
from robot_agent.metrics import RobotMetrics
from robot_agent.settings import load_settings
from swarm import keyspace
from swarm.arrays import unpack_finite
from swarm.errors import RefusedError
from swarm.geometry import Points
from swarm.log import make_logger
from swarm.messages import Backlog, Beacon, Observation, ObservationRequest, SceneDescription
from swarm.session import Session
from tests.support.robot_worlds import ChosenWorld, Robot
from tests.support.zenoh_fixtures import WAIT_S, Inbox, RouterProcess, SessionMaker, until
from worlds.opv2v.world import Opv2vWorld

Start = Callable[..., subprocess.Popen[str]]

ROUNDED = 0.02
"""By so much a score may differ between processes that compute in bfloat16."""


def environment(router: str, swarm: str, **settings: str) -> dict[str, str]:
    """The settings of a robot process, without those of the caller's shell."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("COADAPT_")}
    ours = {"SWARM": swarm, "ROUTER": router, "METRICS_PORT": "0", **settings}
    return kept | {f"COADAPT_{key}": value for key, value in ours.items()}


@pytest.fixture
def start(shared_router: RouterProcess, swarm_name: str, opv2v_dir: Path) -> Iterator[Start]:
    """Starts robot processes in the recorded world; ends them after the test."""
    with ExitStack() as stack:

        def make(**settings: str) -> subprocess.Popen[str]:
            values = {"WORLD": "opv2v", "WORLD_DATA": str(opv2v_dir), **settings}
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "robot_agent"],
                    env=environment(shared_router.address, swarm_name, **values),
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
            stack.callback(process.kill)
            return process

        yield make


@pytest.fixture
def ego(shared_router: RouterProcess, open_session: SessionMaker) -> Session:
    return open_session(shared_router.address)


def request(**changes: object) -> ObservationRequest:
    values: dict[str, object] = {"ego": "E", "request": 1, "algorithm": "early", "capture_ns": 0}
    return ObservationRequest(**{**values, **changes})  # type: ignore[arg-type]


def beacons_of(session: Session) -> Inbox[Beacon]:
    inbox: Inbox[Beacon] = Inbox()
    session.subscribe(keyspace.beacon(session.swarm, keyspace.ANY), Beacon, inbox.put)
    return inbox


def test_two_robots_of_one_process_tell_answer_and_leave(
    start: Start, ego: Session, opv2v_dir: Path
) -> None:
    events: Inbox[tuple[str, str]] = Inbox()
    scenes: Inbox[SceneDescription] = Inbox()
    beacons = beacons_of(ego)
    ego.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    ego.subscribe(keyspace.scene(ego.swarm, keyspace.ANY), SceneDescription, scenes.put)
    world = Opv2vWorld(opv2v_dir)
    # The network as this process runs it: processes choose by themselves, and some in bfloat16.
    backend = detector_backend(world.detector)
    process = start(ROBOTS="302,311", RING_FRAMES="100", DETECTOR_BACKEND=backend)
    assert {events.next(), events.next()} == {("join", "302"), ("join", "311")}

    for robot in ("302", "311"):
        # Frames of old beacons have left the robot's ring.
        beacons.skip()
        beacon = beacons.next_where(lambda b, robot=robot: b.robot == robot and len(b.sizes) > 0)  # type: ignore[misc]
        key = keyspace.observation(ego.swarm, robot)
        early = request(capture_ns=beacon.capture_ns, max_error_m=0.05, keep_ground=True)
        late = request(capture_ns=beacon.capture_ns, algorithm="late")
        answers = [ego.ask(key, asked, Observation, timeout_s=5) for asked in (early, late)]
        assert beacon.pose == world.pose(robot, beacon.frame).as_tuple()
        scene = scenes.next_where(lambda s, robot=robot: s.robot == robot)  # type: ignore[misc]
        assert len(unpack_finite(scene.objects, "objects", 9)) > 5

        got = answers[0].result(WAIT_S).message
        assert (got.frame, got.instance, got.pose) == (beacon.frame, beacon.instance, beacon.pose)
        scan = world.scan(robot, got.frame).points
        decoded = decode_points(take_outline(got.payload)[0])
        assert len(decoded) == len(scan)
        assert cKDTree(decoded).query(scan)[0].max() <= 0.05

        boxes = decode_boxes(take_outline(answers[1].result(WAIT_S).message.payload)[0])
        found = shared_finder(world.detector).find(scan)
        # In bfloat16 two processes may differ by a rounding step of the network's last layer, which
        # may also turn round the order of two boxes, or take one over the threshold.
        assert len(boxes) <= SENT_BOXES
        assert cKDTree(found.centers).query(boxes.centers)[0].max() <= 0.02
        least = max(SENT_SCORE, found.scores[SENT_BOXES - 1 : SENT_BOXES].max(initial=0.0))
        certain = found.centers[found.scores >= least + ROUNDED]
        assert len(certain) > 0
        assert cKDTree(boxes.centers).query(certain)[0].max() <= 0.02
        with pytest.raises(RefusedError, match=r"nearest, .* later; allowed"):
            ego.ask(key, request(capture_ns=1), Observation, timeout_s=5).result(WAIT_S)

    process.send_signal(signal.SIGTERM)
    assert process.wait(WAIT_S) == 0
    assert {events.next(), events.next()} == {("leave", "302"), ("leave", "311")}


def test_requests_for_one_frame_that_come_together_encode_it_once(
    ego: Session, shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    robot = Robot(ChosenWorld())
    robot.sense()
    fusion = robot.agent._encoder._fusions["early"]
    encode = fusion.encode

    def when_both_have_come(points: Points, options: EncodeOptions) -> bytes:
        until(lambda: robot.agent._answering == 2, "both requests are being answered")
        return encode(points, options)

    fusion.encode = when_both_have_come  # type: ignore[method-assign]
    host = open_session(shared_router.address)
    Duty(robot.agent, host, RobotMetrics(CollectorRegistry()), make_logger("test"), Backlog)
    until(lambda: ego.alive() == ("R1",), "the robot is there")
    key = keyspace.observation(ego.swarm, "R1")
    beacon = robot.agent.beacon()
    assert beacon is not None
    both = [
        ego.ask(key, request(ego=name, capture_ns=beacon.capture_ns), Observation, timeout_s=WAIT_S)
        for name in ("E1", "E2")
    ]
    first, second = (future.result(WAIT_S).message for future in both)
    assert first.payload == second.payload
    assert robot.value("coadapt_robot_encode_seconds_count", algorithm="early") == 1


def test_a_killed_robot_leaves(start: Start, ego: Session) -> None:
    events: Inbox[tuple[str, str]] = Inbox()
    ego.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    process = start(ROBOTS="302")
    assert events.next() == ("join", "302")
    process.kill()
    assert events.next() == ("leave", "302")


def test_two_processes_with_one_robot_id_can_be_told_apart(start: Start, ego: Session) -> None:
    beacons = beacons_of(ego)
    start(ROBOTS="302")
    first = beacons.next()
    start(ROBOTS="302")
    second = beacons.next_where(lambda b: b.instance != first.instance)
    assert second.robot == first.robot == "302"
    # The first one goes on.
    beacons.next_where(lambda b: b.instance == first.instance and b.seq > first.seq)


def test_a_robot_whose_clock_is_off_says_so_in_every_time_it_sends(
    start: Start, ego: Session
) -> None:
    beacons = beacons_of(ego)
    start(ROBOTS="302", CLOCK_OFFSET_S="-500", RING_FRAMES="100")
    beacon = beacons.next()
    for told in (beacon.sent_ns, beacon.capture_ns):
        assert abs((time.time_ns() - told) / 1e9 - 500) < WAIT_S
    key = keyspace.observation(ego.swarm, "302")
    asked = request(capture_ns=beacon.capture_ns)
    answer = ego.ask(key, asked, Observation, timeout_s=5).result(WAIT_S)
    assert answer.message.capture_ns == beacon.capture_ns


def test_a_robot_ends_also_while_its_router_is_away(
    start: Start, own_router: RouterProcess, open_session: SessionMaker
) -> None:
    ego = open_session(own_router.address)
    beacons = beacons_of(ego)
    process = start(ROBOTS="302", ROUTER=own_router.address)
    beacons.next()
    own_router.stop(kill=True)
    until(lambda: ego.links() == 0, "the router is away")
    process.send_signal(signal.SIGTERM)
    assert process.wait(WAIT_S) == 0


def test_a_robot_ends_also_before_it_has_found_its_router(
    start: Start, own_router: RouterProcess
) -> None:
    own_router.stop()
    process = start(ROBOTS="302", ROUTER=own_router.address)
    assert process.stderr is not None
    assert "robots_starting" in process.stderr.readline()
    process.send_signal(signal.SIGTERM)
    assert process.wait(WAIT_S) == 0


def test_a_robot_outlives_its_router(
    start: Start, own_router: RouterProcess, open_session: SessionMaker
) -> None:
    ego = open_session(own_router.address)
    beacons = beacons_of(ego)
    start(ROBOTS="302", ROUTER=own_router.address)
    before = beacons.next()
    own_router.stop(kill=True)
    until(lambda: ego.links() == 0, "the router is away")
    own_router.start()
    after = beacons.next_where(lambda b: b.seq > before.seq + 5)
    assert after.instance == before.instance
    until(lambda: ego.alive() == ("302",), "the token is back")
    key = keyspace.observation(ego.swarm, "302")
    assert ego.ask(key, request(), Observation, timeout_s=5).result(WAIT_S).wire_bytes > 0


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"ROBOTS": ""}, "COADAPT_ROBOTS"),
        ({"ROBOTS": "302,302"}, "names a robot twice"),
        ({"ROBOTS": "302,999"}, "names 999, which world 'opv2v' does not have; allowed: 302, 311"),
        ({"ROBOTS": "302", "BEACON_RATE_HZ": "0"}, "COADAPT_BEACON_RATE_HZ = '0'"),
        ({"ROBOTS": "302", "WORLD_DATA": "/nonexistent"}, "/nonexistent"),
        ({"ROBOTS": "302", "WORLD_DATA": ""}, "COADAPT_WORLD_DATA, the directory"),
        ({"ROBOTS": "302", "ROUTER": "here"}, "router 'here' is not valid"),
    ],
)
def test_a_wrong_setting_ends_the_process_with_one_clear_line(
    settings: dict[str, str], told: str, start: Start
) -> None:
    process = start(**settings)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    lines = [line for line in errors.splitlines() if not line.startswith("{")]
    assert len(lines) == 1
    assert lines[0].startswith("robot_agent: ")
    assert told in lines[0]


def test_a_metrics_port_in_use_ends_the_process_with_one_clear_line(start: Start) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = str(taken.getsockname()[1])
        process = start(ROBOTS="302", METRICS_PORT=port)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert f"metrics port {port}" in errors.splitlines()[-1]
    assert "COADAPT_METRICS_PORT" in errors.splitlines()[-1]


def test_one_process_hosts_many_robots(
    shared_router: RouterProcess, ego: Session, swarm_name: str
) -> None:
    names = tuple(f"R{i}" for i in range(100))
    world = ChosenWorld(robots=names)
    prefix = "COADAPT_"
    settings = load_settings(
        {
            key: value
            for key, value in environment(
                shared_router.address,
                swarm_name,
                ROBOTS=",".join(names),
                WORKERS="2",
                BEACON_RATE_HZ="2",
                LOG_LEVEL="error",
            ).items()
            if key.startswith(prefix)
        }
    )
    beacons = beacons_of(ego)
    stop = threading.Event()
    thread = threading.Thread(target=run, args=(settings, world, stop))
    thread.start()
    try:
        seen: set[Any] = set()
        while seen != set(names):
            seen.add(beacons.next().robot)
        until(lambda: len(ego.alive()) == len(names), "all robots are alive")
        asked = [
            ego.ask(keyspace.observation(ego.swarm, name), request(), Observation, timeout_s=10)
            for name in names
        ]
        assert [future.result(WAIT_S).message.robot for future in asked] == list(names)
    finally:
        stop.set()
        thread.join(WAIT_S)
    assert not thread.is_alive()


def test_logs_are_one_json_object_a_line(start: Start, ego: Session) -> None:
    beacons = beacons_of(ego)
    process = start(ROBOTS="302")
    beacons.next()
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    events = [json.loads(line) for line in errors.splitlines()]
    assert [event["event"] for event in events] == ["robots_starting", "robots_up", "robots_down"]
    assert {event["swarm"] for event in events} == {ego.swarm}
