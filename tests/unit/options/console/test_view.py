"""What the console makes of what it hears: the board, the view, and faults."""

from __future__ import annotations

import json
import time
from typing import Any

import msgspec
import numpy as np
import pytest

from options.console.board import MAX_GONE, Board
from options.console.faults import EGO_UNKNOWN_S, PERIODS, SILENT_S, STALE_S, Faults
from options.console.view import MAX_ROBOTS, View
from swarm.arrays import Array, pack
from swarm.messages import (
    MIXED,
    Assignment,
    Beacon,
    Decision,
    Detections,
    GatewayState,
    LinkState,
    NetState,
    SceneDescription,
    ShapeRequest,
)
from tests.support.console_swarm import EGO, rows
from tests.support.message_samples import SAMPLES

VISIBLE = pack(np.full((72, 1), 9.5, np.float32))


def test_the_board_gives_the_newest_value_once() -> None:
    board = Board()
    board.put("a", 1)
    board.put("a", 2)
    number, found = board.since(0)
    assert json.loads(b"{%b}" % found) == {"state": {"a": 2}, "history": [], "faults": []}
    assert json.loads(b"{%b}" % board.since(number)[1])["state"] == {}
    board.put("a", None)
    board.append("faults", "x")
    assert json.loads(b"{%b}" % board.since(number)[1]) == {
        "state": {"a": None},
        "history": [],
        "faults": ["x"],
    }


def test_the_board_forgets_names_that_have_had_no_value_for_long() -> None:
    board = Board()
    for i in range(MAX_GONE + 1):
        board.put(f"robot/R{i}", None)
    state = json.loads(b"{%b}" % board.since(0)[1])["state"]
    assert "robot/R0" not in state
    assert len(state) == MAX_GONE


@pytest.fixture
def board() -> Board:
    return Board()


@pytest.fixture
def view(board: Board) -> View:
    return View(board, "seen", EGO, 45.0)


def shown(board: Board) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(b"{%b}" % board.since(0)[1])
    return found


def beacon(robot: str) -> Beacon:
    return Beacon(
        robot=robot,
        instance=1,
        seq=1,
        sent_ns=1,
        capture_ns=1,
        frame=1,
        pose=(1.0, 2.0, 0.0, 0.0, 0.0, 0.0),
        velocity=(0.0, 0.0, 0.0),
        range_m=30.0,
        sizes={},
    )


def test_a_new_robot_takes_the_place_of_the_one_that_left_first(view: View, board: Board) -> None:
    for i in range(MAX_ROBOTS):
        view.on_join(f"R{i}")
    view.on_join("new")
    assert "robot/new" not in shown(board)["state"]
    view.on_leave("R7")
    # One that is only heard of drives nobody out.
    view.on_beacon(beacon("heard"))
    assert shown(board)["state"]["robot/R7"] is not None
    view.on_join("new")
    state = shown(board)["state"]
    assert state["robot/new"]["alive"]
    assert state["robot/R7"] is None
    assert "robot/heard" not in state


def test_faults_of_more_robots_than_a_swarm_has_are_not_kept(view: View, board: Board) -> None:
    torn = Array(dtype="<f4", shape=(3, 9), data=b"")
    for i in range(MAX_ROBOTS + 10):
        scene = SceneDescription(
            robot=f"R{i}",
            instance=1,
            seq=1,
            sent_ns=1,
            capture_ns=1,
            frame=1,
            pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            objects=torn,
            visible_m=VISIBLE,
            ground_points=0,
            elapsed_ms=1.0,
        )
        view.on_scene(scene)
    assert len([name for name in view._faults._open if name.startswith("unreadable")]) == MAX_ROBOTS


def test_the_first_figures_count_from_when_somebody_looks(
    view: View, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 1000.0
    monkeypatch.setattr("options.console.view.monotonic", lambda: now)
    view.on_decision(decision(1))
    now += 60
    view.sees()
    now += 1
    received = Detections(
        ego=EGO,
        cycle=1,
        frame=1,
        capture_ns=1,
        algorithm="early",
        participants=(EGO, "R2"),
        boxes=rows(7),
        scores=rows(1),
        labels=(),
        bytes={"R2": 5000},
        latency_ms=31.0,
    )
    view.on_detections(received)
    view.on_decision(decision(2))
    assert shown(board)["history"][-1]["used_bps"] == 8 * 5000


def test_what_is_remembered_is_shown_beside_what_is_seen(view: View, board: Board) -> None:
    found = next(sample for sample in SAMPLES if isinstance(sample, Detections))
    assert found.tracks is not None
    view.on_detections(msgspec.structs.replace(found, ego=EGO))
    value = shown(board)["state"]["detections"]
    assert value["remembered"] == [[0.0, 1.0, 3.0, 4.0, 6.0, 0.75, 0.5]]
    seen_now = msgspec.structs.replace(found.tracks, ages_s=pack(np.zeros((1, 1), np.float32)))
    for tracks in (None, seen_now):
        view.on_detections(msgspec.structs.replace(found, ego=EGO, tracks=tracks))
        assert shown(board)["state"]["detections"]["remembered"] == []


def test_how_often_each_contributes_is_shown(view: View, board: Board) -> None:
    decided = next(sample for sample in SAMPLES if isinstance(sample, Decision))
    view.on_decision(decided)
    assert shown(board)["state"]["decision"]["assignments"] == [
        ["R1", "early", 1.0, 5.0, True],
        ["R3", "late", 2.0, 0.0, False],
    ]


def test_the_past_says_how_many_have_sent_each_form(view: View, board: Board) -> None:
    sent = (("R2", "early", 10.0), ("R3", "late", 2.0), ("R4", "early", 5.0))
    mixed = msgspec.structs.replace(
        decision(1),
        participants=(EGO, "R2", "R3", "R4"),
        algorithm=MIXED,
        assignments=tuple(
            Assignment(robot=robot, algorithm=form, rate_hz=hz) for robot, form, hz in sent
        ),
    )
    view.on_decision(mixed)
    view.on_decision(decision(2))
    assert [past["forms"] for past in shown(board)["history"]] == [{"early": 2, "late": 1}, {}]


def test_a_clock_that_is_set_back_hides_no_silence(
    view: View, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    steady = 1000.0
    monkeypatch.setattr("options.console.view.monotonic", lambda: steady)
    view.tick(True)
    view.sees()
    view.on_join("R2")
    view.on_beacon(beacon("R2"))
    clock = time.time()
    monkeypatch.setattr("options.console.board.time.time", lambda: clock - 3600)
    steady += SILENT_S + 1
    view.tick(True)
    assert shown(board)["faults"][-1]["text"] == "R2 is alive but sends no beacons"
    view.on_beacon(beacon("R2"))
    assert shown(board)["faults"][-1]["text"] == "R2 sends beacons again"


def test_what_frames_of_a_robot_take_is_told_when_it_changes(view: View, board: Board) -> None:
    view.on_join("R2")
    view.on_beacon(msgspec.structs.replace(beacon("R2"), sizes={"early": 4000}))
    number, found = board.since(0)
    assert json.loads(b"{%b}" % found)["state"]["sizes/R2"] == {"early": 4000}
    for sizes in ({"early": 4000}, {}):
        view.on_beacon(msgspec.structs.replace(beacon("R2"), sizes=sizes))
    number, found = board.since(number)
    assert "sizes/R2" not in json.loads(b"{%b}" % found)["state"]
    view.on_beacon(msgspec.structs.replace(beacon("R2"), sizes={"early": 5000}))
    assert json.loads(b"{%b}" % board.since(number)[1])["state"]["sizes/R2"] == {"early": 5000}


def decision(cycle: int, *, valid: bool = True) -> Decision:
    return Decision(
        ego=EGO,
        cycle=cycle,
        decided_ns=1,
        participants=(EGO,),
        algorithm="early",
        reason="why",
        source="policy",
        policy="coverage",
        valid=valid,
    )


def test_the_links_of_several_hosts_are_shown_together(view: View, board: Board) -> None:
    for seq, (name, robot) in enumerate((("hall-1", EGO), ("hall-2", "R7"))):
        link = LinkState(
            robot=robot,
            direction="down",
            capacity_bps=5_000_000,
            available_bps=4_000_000,
            latency_ms=0.0,
            level=0,
            classes={},
        )
        why = ("R7 up: refused",) if name == "hall-2" else ()
        state = NetState(controller=seq, seq=seq, sent_ns=0, links=(link,), name=name, unshaped=why)
        view.on_net_state(state)
    net = shown(board)["state"]["net"]
    assert [link["robot"] for link in net["links"]] == [EGO, "R7"]
    assert net["unshaped"] == ["controller hall-2: R7 up: refused"]
    # What is asked here goes to who has the link.
    assert list(view.addressees(ShapeRequest(profile="congest", robot="R7"))) == ["hall-2"]
    assert list(view.addressees(ShapeRequest(profile="congest"))) == ["hall-1"]


def test_the_ego_that_stands_in_is_shown_and_told(view: View, board: Board) -> None:
    other = msgspec.structs.replace(decision(1), ego="R9", stands_in_for=EGO)
    view.on_decision(decision(7))
    view.on_decision(other)
    assert shown(board)["state"]["swarm"]["ego"] == view.ego == "R9"
    view.on_decision(decision(8))
    assert shown(board)["state"]["swarm"]["ego"] == EGO
    assert [fault["text"] for fault in shown(board)["faults"]] == [
        f"ego R9 stands in for {EGO}",
        f"ego {EGO} decides itself again",
    ]


def test_faults_are_told_when_they_begin_and_when_they_end() -> None:
    said: list[str] = []
    faults = Faults(EGO, lambda fault: said.append(fault["text"]))
    faults.tick(0.0, True, {})
    faults.net_state(0.0)
    faults.decision(0.0, decision(1))
    faults.decision(1.0, decision(2, valid=False))
    faults.decision(2.0, decision(3))
    assert said == ["no valid decision: why", "decisions are valid again"]
    said.clear()
    for now in (2.5, STALE_S + 0.1, STALE_S + 1):
        faults.tick(now, True, {})
    faults.net_state(STALE_S + 2)
    assert said == [
        "telemetry of the links is stale: C(t) is not measured",
        "telemetry of the links comes again",
    ]
    said.clear()
    faults.tick(20.0, True, {})
    faults.net_state(20.0)
    faults.decision(21.0, decision(1))
    assert "ego R1 decides no more" in said
    assert said[-2:] == ["ego R1 decides again", "ego R1 has started anew"]


def test_a_language_model_that_does_not_answer_is_told_once_each_way() -> None:
    said: list[dict[str, Any]] = []
    faults = Faults(EGO, said.append)
    for trouble in ("", "refused by h:1", "refused by h:1", "no answer from h:1", "", ""):
        faults.gateway_state(GatewayState(model="m", trouble=trouble))
    assert [(event["level"], event["text"]) for event in said] == [
        ("fault", "the language model does not answer: refused by h:1"),
        ("good", "the language model answers again: m"),
    ]
    said.clear()
    faults.gateway_state(GatewayState(model="m", trouble="refused by h:1"))
    faults.gateway(False)
    faults.gateway(True)
    faults.gateway_state(GatewayState(model="m", trouble=""))
    assert [event["text"] for event in said[1:]] == [
        "the LLM gateway is away",
        "the LLM gateway is back",
    ]


def test_an_ego_that_decides_rarely_is_not_silent_between_two_decisions() -> None:
    said: list[str] = []
    faults = Faults(EGO, lambda fault: said.append(fault["text"]))
    faults.tick(0.0, True, {})
    faults.decision(0.0, decision(1))
    faults.decision(30.0, decision(2))
    said.clear()
    faults.tick(30.0 + 30.0 * PERIODS - 1, True, {})
    assert said == []


def test_an_outage_does_not_make_an_ego_rare() -> None:
    said: list[str] = []
    faults = Faults(EGO, lambda fault: said.append(fault["text"]))
    faults.tick(0.0, True, {})
    for cycle, now in enumerate((0.0, 1.0, 2.0, 600.0), 1):
        faults.decision(now, decision(cycle))
    said.clear()
    faults.tick(610.0, True, {})
    assert said == [f"ego {EGO} decides no more"]


def test_before_its_second_decision_nobody_knows_how_rarely_an_ego_decides() -> None:
    said: list[str] = []
    faults = Faults(EGO, lambda fault: said.append(fault["text"]))
    faults.tick(0.0, True, {})
    faults.decision(0.0, decision(1))
    faults.tick(EGO_UNKNOWN_S - 1, True, {})
    assert said == []
    faults.tick(EGO_UNKNOWN_S + 1, True, {})
    assert said == [f"ego {EGO} decides no more"]


def test_a_router_that_was_away_is_no_fault_of_those_behind_it() -> None:
    said: list[str] = []
    faults = Faults(EGO, lambda fault: said.append(fault["text"]))
    faults.tick(0.0, True, {"R2": 0.0})
    for cycle in (1, 2):
        faults.decision(float(cycle), decision(cycle))
    faults.net_state(2.0)
    faults.tick(3.0, False, {"R2": 2.5})
    faults.tick(60.0, True, {"R2": 2.5})
    assert said == ["the swarm's router cannot be reached", "the swarm's router answers again"]
    said.clear()
    faults.tick(60.0 + SILENT_S + 0.1, True, {"R2": 2.5})
    assert said == ["R2 is alive but sends no beacons"]
