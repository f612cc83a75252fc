"""A page is told everything on connect, then what changes, and how old each datum is."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from options.console.answers import Floor
from options.console.board import Board
from options.console.faults import SILENT_S
from options.console.floor import floor_of
from options.console.hub import STEP_S
from options.console.view import View
from options.console.watch import Watch
from swarm.arrays import Array, pack
from swarm.errors import TransportError
from swarm.log import make_logger
from swarm.messages import Beacon, Message
from swarm.session import Session
from tests.support.console_swarm import EGO, Speakers, Viewer, console, rows
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker, until
from worlds.factory.world import FactoryWorld

VISIBLE = pack(np.full((72, 1), 9.5, np.float32))
OBJECTS = rows(9, (12.0, 8.0, 0.5, 3.0, 2.0, 1.0, 1.5, 40.0, 9.0))


@pytest.fixture
def port(shared_router: RouterProcess, swarm_name: str) -> Iterator[int]:
    with console(shared_router.address, swarm_name) as port:
        yield port


@pytest.fixture
def speakers(shared_router: RouterProcess, open_session: SessionMaker) -> Speakers:
    return Speakers(open_session(shared_router.address))


@pytest.fixture
def viewers(port: int) -> Iterator[Callable[[], Viewer]]:
    opened: list[Viewer] = []

    def look() -> Viewer:
        opened.append(Viewer(port))
        return opened[-1]

    yield look
    for viewer in opened:
        viewer.close()


def say_all(speakers: Speakers, cycle: int = 1) -> None:
    speakers.robot("R1", 10.0, 8.0)
    speakers.robot("R2", 14.0, 8.0, yaw=1.5)
    speakers.scene("R2", 14.0, 8.0, VISIBLE, OBJECTS)
    speakers.detections((12.0, 8.0, 0.5, 2.0, 1.0, 1.0, 0.3), R2=5000)
    speakers.decision(cycle, "R1", "R2")
    speakers.demand(reachable=True)
    speakers.net_state(5_000_000, 1_000_000)


def hear(viewer: Viewer, say: Callable[[], None], holds: Callable[[], bool], what: str) -> None:
    """Says it until the subscription has reached the speaker and the viewer has seen it."""

    def again() -> bool:
        say()
        return holds()

    viewer.until(again, what)


def names(viewer: Viewer) -> set[str]:
    return {name for name, value in viewer.state.items() if value is not None}


def test_a_viewer_gets_all_that_is_known_and_a_second_one_the_same_at_once(
    speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    first = viewers()
    speakers._session.declare_alive("R2")
    everything = {
        *("swarm", "robot/R1", "robot/R2", "scene/R2", "detections"),
        *("decision", "demand", "net", "traffic"),
    }
    hear(first, lambda: say_all(speakers), lambda: names(first) >= everything, "all is shown")
    first.until(lambda: first.state["robot/R2"]["alive"], "R2 is alive")
    second = viewers()
    second.next()
    assert names(second) >= everything
    robot = second.state["robot/R2"]
    assert (robot["x"], robot["y"], robot["yaw"], robot["range_m"]) == (14.0, 8.0, 1.5, 30.0)
    assert second.state["scene/R2"]["objects"] == [[12.0, 8.0, 2.0, 1.0]]
    assert second.state["scene/R2"]["visible_m"] == [9.5] * 72
    assert second.state["detections"]["boxes"] == [[12.0, 8.0, 2.0, 1.0, 0.3, 0.9]]
    assert second.state["decision"]["participants"] == ["R1", "R2"]
    assert second.state["decision"]["reason"] == "2 see more"
    assert second.state["net"]["links"][0]["used_bps"] == 1_000_000
    assert second.state["traffic"]["bps"]["R2"] > 0
    assert second.history[-1]["algorithm"] == "early"


def test_a_change_comes_in_the_stream_that_is_open_and_brings_nothing_else(
    speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    viewer = viewers()
    viewer.until(lambda: viewer.state["swarm"]["connected"], "the swarm is there")
    hear(viewer, lambda: say_all(speakers), lambda: "decision" in viewer.state, "a decision")
    cycle = 1000
    event: dict[str, Any] = {"state": {}}
    while event["state"].get("decision", {}).get("cycle") != cycle:
        speakers.decision(cycle, "R1", algorithm="late", reason="alone")
        event = viewer.next()
    assert event["state"]["decision"]["algorithm"] == "late"
    assert event["history"][-1]["cycle"] == cycle
    assert "swarm" not in event["state"]


def test_what_has_come_no_more_keeps_the_time_when_it_came(
    speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    viewer = viewers()
    speakers._session.declare_alive("R2")
    hear(viewer, lambda: say_all(speakers), lambda: "at" in viewer.state.get("robot/R2", {}), "R2")
    viewer.until(lambda: viewer.state["robot/R2"]["alive"], "R2 is alive")
    viewer.until(lambda: any("no beacons" in f["text"] for f in viewer.faults), "R2 is silent")
    assert viewer.now - viewer.state["robot/R2"]["at"] > SILENT_S
    # A page that is opened now is not told that R2 has just been heard.
    with Viewer(viewer.port) as late:
        late.next()
        assert late.state["robot/R2"]["at"] == viewer.state["robot/R2"]["at"]


def test_a_robot_that_leaves_is_a_fault_and_since_when_is_told(
    speakers: Speakers,
    viewers: Callable[[], Viewer],
    shared_router: RouterProcess,
    open_session: SessionMaker,
) -> None:
    viewer = viewers()
    robot = open_session(shared_router.address)
    robot.declare_alive("R3")
    viewer.until(lambda: viewer.state.get("robot/R3", {}).get("alive"), "R3 is there")
    robot.close()
    viewer.until(lambda: not viewer.state["robot/R3"]["alive"], "R3 is gone")
    viewer.until(lambda: any(f["text"] == "R3 is lost" for f in viewer.faults), "the fault")
    fault = next(f for f in viewer.faults if f["text"] == "R3 is lost")
    assert (fault["level"], fault["robot"]) == ("fault", "R3")
    assert abs(fault["at"] - viewer.state["robot/R3"]["since"]) < 1


def test_a_router_that_goes_away_is_told_with_since_when_and_its_return_too(
    own_router: RouterProcess, swarm_name: str
) -> None:
    with console(own_router.address, swarm_name) as port, Viewer(port) as viewer:
        viewer.until(lambda: viewer.state["swarm"]["connected"], "connected")
        before = viewer.now
        own_router.stop()
        viewer.until(lambda: not viewer.state["swarm"]["connected"], "gone")
        assert before < viewer.state["swarm"]["since"] <= viewer.now
        own_router.start()
        viewer.until(lambda: viewer.state["swarm"]["connected"], "back")


def test_before_any_router_a_page_is_served_and_says_so(swarm_name: str) -> None:
    with console("tcp/127.0.0.1:1", swarm_name) as port, Viewer(port) as viewer:
        viewer.next()
        assert viewer.state["swarm"]["connected"] is False


def test_the_router_is_told_reached_before_everything_is_listened_to(
    shared_router: RouterProcess, swarm_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = threading.Event()

    def held(watch: Watch) -> Session:
        told.wait(20)
        raise TransportError("too late")

    monkeypatch.setattr(Watch, "_open_all", held)
    view = View(Board(), swarm_name, EGO, 45.0)
    watch = Watch(view, shared_router.address, swarm_name, EGO, make_logger("test", level="error"))
    try:
        watch.look(1)
        until(lambda: view.connected, "it is told")
    finally:
        told.set()
        watch.close()


def test_a_session_that_is_lost_at_once_is_opened_again(
    speakers: Speakers, viewers: Callable[[], Viewer], monkeypatch: pytest.MonkeyPatch
) -> None:
    subscribe = Session.subscribe
    lost: list[Session] = []

    def lost_once(
        session: Session, key: str, kind: type[Message], handler: Any, *more: Any
    ) -> None:
        if kind is Beacon and not lost:
            lost.append(session)
            raise TransportError("cannot declare: the session is closed")
        subscribe(session, key, kind, handler, *more)

    monkeypatch.setattr(Session, "subscribe", lost_once)
    viewer = viewers()
    hear(viewer, lambda: say_all(speakers), lambda: "at" in viewer.state.get("robot/R2", {}), "R2")
    assert lost[0].links() == 0


def test_a_viewer_who_reads_nothing_neither_blocks_the_others_nor_gets_old_states(
    port: int, speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    fast = viewers()
    big = rows(9, *[(float(i), 1.0, 0.5, 3.0, 1.0, 1.0, 1.0, 9.0, 9.0) for i in range(256)])
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", port))
        slow.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        sent = 0

        def say() -> None:
            nonlocal sent
            sent += 1
            for robot in ("R1", "R2", "R3", "R4"):
                speakers.scene(robot, 1.0, 1.0, VISIBLE, big)
            speakers.decision(sent, EGO)

        hear(fast, say, lambda: fast.state.get("decision", {}).get("cycle", 0) > 70, "changes")
        last = fast.state["decision"]["cycle"]
        events = fast.events
        assert events > 40
        # What waits for the slow one fits the buffers on the way; the rest was never kept.
        cycles: list[int] = []
        rest = b""
        slow.settimeout(20)
        while not cycles or cycles[-1] < last:
            rest += slow.recv(1 << 16)
            *lines, rest = rest.split(b"\n\n")
            for line in lines:
                state = json.loads(line[line.index(b"data: {") + 6 :])["state"]
                if "decision" in state:
                    cycles.append(state["decision"]["cycle"])
        assert cycles == sorted(cycles)
        assert len(cycles) < events / 2


def test_ten_viewers_see_the_same(speakers: Speakers, viewers: Callable[[], Viewer]) -> None:
    ten = [viewers() for _ in range(10)]
    hear(ten[0], lambda: say_all(speakers), lambda: "decision" in ten[0].state, "a decision")
    for viewer in ten:
        # Under congestion a message is dropped, so that it is said until it has come.
        hear(
            viewer,
            lambda: speakers.decision(77, "R1"),
            lambda v=viewer: v.state.get("decision", {}).get("cycle") == 77,  # type: ignore[misc]
            "the same",
        )


def test_events_come_no_faster_than_a_screen_shows_them(
    speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    viewer = viewers()
    times = []

    def say() -> None:
        for _ in range(20):
            speakers.robot("R1", float(speakers.seq % 50), 8.0)

    for _ in range(30):
        say()
        viewer.next()
        times.append(viewer.now)
    # The first of them may share a step with the one before.
    assert len(times) / (times[-1] - times[0] + 1e-9) < 1.5 / STEP_S


def test_nothing_of_robots_is_heard_while_nobody_looks(
    speakers: Speakers, viewers: Callable[[], Viewer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("options.console.watch.LINGER_S", 0.1)
    viewer = viewers()
    hear(viewer, lambda: say_all(speakers), lambda: "at" in viewer.state.get("robot/R2", {}), "R2")
    port = viewer.port
    viewer.close()
    deadline = time.monotonic() + 20
    while True:
        speakers.robot("R2", 1.0, 1.0)
        speakers.decision(500, "R1")
        with Viewer(port) as again:
            again.next()
        robot, decided = again.state.get("robot/R2"), again.state.get("decision", {})
        if robot is not None and "at" not in robot and decided.get("cycle") == 500:
            break
        assert time.monotonic() < deadline
        time.sleep(0.7)
    assert "scene/R2" not in names(again)
    assert "detections" not in names(again)


def test_arrays_that_do_not_fit_together_are_a_fault_told_once(
    speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    viewer = viewers()
    torn = Array(dtype="<f4", shape=(3, 9), data=b"\0" * 8)

    def say() -> None:
        speakers.scene("R2", 0.0, 0.0, VISIBLE, torn)
        speakers.robot("R1", 1.0, 1.0)

    hear(viewer, say, lambda: bool(viewer.faults), "the fault")
    for _ in range(5):
        say()
        viewer.next()
    assert len([f for f in viewer.faults if "R2 sends arrays" in f["text"]]) == 1
    assert "scene/R2" not in viewer.state


def test_a_model_server_that_is_away_is_one_event_and_its_return_another(
    speakers: Speakers, viewers: Callable[[], Viewer]
) -> None:
    viewer = viewers()
    away = "refused by 127.0.0.1:8000"
    hear(viewer, lambda: speakers.gateway_state(away), lambda: bool(viewer.faults), "it is away")
    for _ in range(5):
        speakers.gateway_state(away)
    hear(viewer, lambda: speakers.gateway_state(""), lambda: len(viewer.faults) > 1, "it is back")
    assert [(fault["level"], fault["text"]) for fault in viewer.faults] == [
        ("fault", f"the language model does not answer: {away}"),
        ("good", "the language model answers again: test-model"),
    ]


def test_the_floor_plan_is_that_of_the_simulated_factory() -> None:
    shown = floor_of("factory", 6, 1)
    floor = FactoryWorld(robots=6, seed=1).floor
    assert (shown.width_m, shown.depth_m) == (floor.width_m, floor.depth_m)
    pairs = {tuple(round(float(v), 2) for v in box[[0, 1, 3, 4]]) for box in floor.boxes}
    assert len(shown.rects) > 50
    assert set(shown.rects) <= pairs
    names = {place.name for place in shown.places}
    assert {"docks", "crossing", "racks", "aisle 1"} <= names
    assert floor_of("opv2v", 2, 1) == Floor(width_m=None, depth_m=None, rects=(), places=())
