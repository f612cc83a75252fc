"""What `coadapt status` shows is what the swarm says over Zenoh."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coadapt.commands.status import render
from coadapt.main import main
from deploy.observe import Watch
from deploy.runtime import ProcessStatus
from deploy.spec import make_spec
from deploy.state import State
from deploy.view import RobotRow, SwarmView
from swarm import keyspace
from swarm.arrays import pack
from swarm.messages import (
    AdviceReport,
    Beacon,
    Decision,
    Detections,
    RobotSteered,
    RobotSteering,
)
from swarm.session import Session
from swarm.zenoh_config import router_config, router_json5

SWARM = "shown"
WAIT_S = 20.0


@pytest.fixture(scope="module")
def state() -> Iterator[State]:
    """A running router, and the record of a swarm of two robots at it."""
    directory = Path(tempfile.mkdtemp(prefix="ca-", dir="/tmp"))
    path = directory / "router.sock"
    config = router_config("127.0.0.1", 7447, str(path))
    config["listen/endpoints"] = [f"unixsock-stream/{path}"]
    (directory / "router.json5").write_text(router_json5(config))
    router = subprocess.Popen(
        [sys.executable, "-m", "swarm.router", "--config", str(directory / "router.json5")],
        stderr=subprocess.DEVNULL,
    )
    spec = make_spec(
        swarm=SWARM, robots=("R1", "R2"), run_dir=str(directory), var_dir=str(directory)
    )
    yield State(runtime="netns", spec=spec, router=f"unixsock-stream/{path}")
    router.send_signal(signal.SIGTERM)
    router.wait(WAIT_S)
    shutil.rmtree(directory)


@pytest.fixture
def robots(state: State) -> Iterator[Session]:
    """A session that plays the robots and the ego."""
    with Session(state.router, SWARM, timeout_s=WAIT_S) as session:
        yield session


def beacon(robot: str, x: float, seq: int) -> Beacon:
    return Beacon(
        robot=robot,
        instance=1,
        seq=seq,
        sent_ns=1,
        capture_ns=1,
        frame=seq,
        pose=(x, 2.0, 0.5, 0.0, 0.0, 0.0),
        velocity=(0.0, 0.0, 0.0),
        range_m=30.0,
        sizes={},
    )


def decision(cycle: int, ego: str = "R1", other: str = "R2") -> Decision:
    return Decision(
        ego=ego,
        cycle=cycle,
        decided_ns=1,
        participants=(ego, other),
        algorithm="late",
        reason="two see more",
        source="policy",
        policy="coverage",
        valid=True,
        capacity_bps=5e6,
    )


def detections(frame: int) -> Detections:
    return Detections(
        ego="R1",
        cycle=1,
        frame=frame,
        capture_ns=1,
        algorithm="late",
        participants=("R1", "R2"),
        boxes=pack(np.zeros((0, 7), np.float32)),
        scores=pack(np.zeros((0, 1), np.float32)),
        labels=(),
        bytes={"R2": 500},
        latency_ms=1.0,
    )


def test_the_view_holds_robots_decision_and_received_bytes(state: State, robots: Session) -> None:
    robots.declare_alive("R1")
    robots.declare_alive("R2")
    with Watch(state, timeout_s=WAIT_S) as watch:
        deadline = time.monotonic() + WAIT_S
        seq = 0
        view = watch.view()
        # Published again until the subscription has reached the publisher.
        while time.monotonic() < deadline and not (
            watch.decided()
            and watch.alive() == {"R1", "R2"}
            and view.frames_per_s > 0
            and all(row.position for row in view.robots)
        ):
            seq += 1
            robots.put(keyspace.beacon(SWARM, "R1"), beacon("R1", 0.0, seq))
            robots.put(keyspace.beacon(SWARM, "R2"), beacon("R2", 3.0, seq))
            robots.put(keyspace.decision(SWARM, "R1"), decision(seq))
            robots.put(keyspace.detections(SWARM, "R1"), detections(seq))
            watch.wait(0.05)
            view = watch.view()
    ego, other = view.robots
    assert (ego.robot, ego.alive, ego.distance_m) == ("R1", True, 0.0)
    assert (other.robot, other.alive, other.selected) == ("R2", True, True)
    assert other.position == (3.0, 2.0, 0.5)
    assert other.distance_m == 3.0
    assert other.bytes_per_s == view.bytes_per_s > 0
    assert other.bytes_per_s == pytest.approx(500 * view.frames_per_s, rel=0.02)
    assert (view.algorithm, view.source, view.capacity_bps) == ("late", "policy", 5e6)
    assert view.reason == "two see more"


def test_off_duty_lost_silent_and_stalled_are_told_apart(state: State) -> None:
    names = ("well", "off", "lost", "mute", "stuck")
    spec = make_spec(swarm=SWARM, robots=names, run_dir=state.spec.run_dir)
    off = RobotSteered(request=0, robot="off", on_duty=False, operator="anna", since_ns=1)
    on = RobotSteered(request=0, robot="mute", on_duty=True)
    with (
        Session(state.router, SWARM, timeout_s=WAIT_S) as robots,
        Watch(State(runtime="netns", spec=spec, router=state.router), timeout_s=WAIT_S) as watch,
    ):
        for robot in ("well", "mute", "stuck"):
            robots.declare_alive(robot)
        for reply in (off, on):
            key = keyspace.robot_steering(SWARM, reply.robot)
            robots.serve(key, RobotSteering, lambda _, reply=reply: reply)  # type: ignore[misc]

        def states() -> dict[str, str | None]:
            robots.put(keyspace.beacon(SWARM, "well"), beacon("well", 0.0, time.time_ns()))
            watch.ask_unheard()
            return {row.robot: row.state for row in watch.view().robots}

        expected = {
            "well": "well",
            "off": "off duty",
            "lost": "lost",
            "mute": "silent",
            "stuck": "stalled",
        }
        _await(watch, lambda: {r: states().get(r) for r in expected} == expected)
        row = next(r for r in watch.view().robots if r.robot == "off")
        assert row.why == "by anna"


def test_what_is_old_to_the_ego_is_shown_as_old_with_the_reason(
    state: State, robots: Session
) -> None:
    robots.declare_alive("R2")
    why = "its beacon shows it as it was 4.2 s ago"
    blind = msgspec.structs.replace(
        decision(1), excluded={"R2": why}, ages_s={"R2": 4.2}, blind="nobody is heard"
    )
    with Watch(state, timeout_s=WAIT_S) as watch:

        def shown() -> RobotRow:
            robots.put(keyspace.beacon(SWARM, "R2"), beacon("R2", 3.0, time.time_ns()))
            robots.put(keyspace.decision(SWARM, "R1"), blind)
            return next(r for r in watch.view().robots if r.robot == "R2")

        _await(watch, lambda: (shown().age_s or 0.0) >= 4.2 and shown().why == why)
        text = render(watch.view(), [])
    assert "BLIND      nobody is heard" in text
    assert why in text


def test_a_robot_that_leaves_is_shown_as_gone(state: State) -> None:
    with Watch(state, timeout_s=WAIT_S) as watch:
        with Session(state.router, SWARM, timeout_s=WAIT_S) as session:
            session.declare_alive("R2")
            _await(watch, lambda: "R2" in watch.alive())
            assert next(r for r in watch.view().robots if r.robot == "R2").alive
        _await(watch, lambda: "R2" not in watch.alive())
        assert not next(r for r in watch.view().robots if r.robot == "R2").alive


def _await(watch: Watch, holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not holds():
        assert time.monotonic() < deadline
        watch.wait(0.2)


VIEW = SwarmView(
    swarm="hall",
    runtime="netns",
    ego="R1",
    cycle=7,
    selected=("R1", "R2"),
    algorithm="early",
    source="policy",
    policy="coverage",
    valid=True,
    reason="because",
    capacity_bps=5e6,
    cell_bps=6_000_000,
    cell_level=1,
    quality=0.9,
    bytes_per_s=1234.0,
    frames_per_s=9.5,
    robots=(
        RobotRow(
            robot="R1",
            alive=True,
            age_s=0.1,
            position=(1.0, 2.0, 0.0),
            distance_m=0.0,
            selected=True,
            bytes_per_s=0.0,
        ),
        RobotRow(
            robot="R2",
            alive=False,
            age_s=None,
            position=None,
            distance_m=None,
            selected=True,
            bytes_per_s=1234.0,
        ),
    ),
)


def test_the_table_shows_each_robot_the_decision_and_each_process() -> None:
    text = render(VIEW, [ProcessStatus("robot-R2", "restarting", 3, 0.0, "last ended with x")])
    rows = {line.split()[0]: line for line in text.splitlines() if line}
    assert "ego" in rows["R1"]
    assert "NO" in rows["R2"]
    assert "1,234" in rows["R2"]
    assert "early from R1, R2" in rows["decision"]
    assert "because" in rows["reason"]
    assert "C(t) = 5.0 Mbit/s (cell: 6.0 Mbit/s, level 1)" in rows["link"]
    assert "restarting" in rows["robot-R2"]
    assert "last ended with x" in rows["robot-R2"]


def test_a_language_model_that_does_not_answer_is_told() -> None:
    trouble = "refused by 127.0.0.1:8000"
    text = render(msgspec.structs.replace(VIEW, model_trouble=trouble), [])
    assert f"model      does not answer: {trouble}" in text.splitlines()
    assert "model " not in render(VIEW, [])


def shown(advice: AdviceReport) -> str:
    text = render(msgspec.structs.replace(VIEW, policy="llm", source="hold", advice=advice), [])
    return next(line for line in text.splitlines() if line.startswith("advice"))


def test_the_table_shows_how_the_ego_stands_with_its_language_model() -> None:
    held = AdviceReport(
        state="held", gateway=True, question=7, asked_s=3.2, model="smollm2-135m", age_s=12.1
    )
    assert shown(held) == "advice     held 12 s: smollm2-135m, asked 3 s ago (question 7)"
    refused = AdviceReport(
        state="refused", gateway=True, question=8, asked_s=1.0, refusal="refused: too dear"
    )
    assert shown(refused).endswith("refused, asked 1 s ago (question 8); last: refused: too dear")
    gone = AdviceReport(state="none", gateway=False, question=8, asked_s=9.0)
    assert shown(gone) == "advice     none, no LLM gateway is connected"
    assert "advice" not in render(VIEW, [])


@pytest.mark.parametrize("command", ["status", "logs", "metrics"])
def test_without_a_swarm_a_command_says_so_and_fails(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    assert main([command, "--swarm", "nowhere"]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "no swarm 'nowhere' is running" in shown.err


def test_down_without_a_swarm_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    assert main(["down", "--swarm", "nowhere"]) == 0
    assert "no swarm 'nowhere' was running" in capsys.readouterr().out


def test_a_run_directory_of_someone_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if os.getuid() != 0:
        pytest.skip("only root can give a directory away")
    base = tmp_path / "base"
    (base / "theirs").mkdir(parents=True)
    os.chown(base, 12345, 12345)
    monkeypatch.setenv("COADAPT_RUN_DIR", str(base))
    assert main(["up", "--swarm", "theirs", "--runtime", "netns", "--no-prometheus"]) == 1
    assert "belongs to someone else" in capsys.readouterr().err


def test_every_ego_and_its_decision_is_told_where_there_are_several(
    state: State, robots: Session
) -> None:
    spec = msgspec.structs.replace(state.spec, egos=("R1", "R2"))
    several = msgspec.structs.replace(state, spec=spec)
    with Watch(several, timeout_s=WAIT_S) as watch:
        assert watch.undecided() == ("R1", "R2")

        def told() -> bool:
            robots.put(keyspace.decision(SWARM, "R1"), decision(7))
            robots.put(keyspace.decision(SWARM, "R2"), decision(9, "R2", "R1"))
            return watch.undecided() == ()

        deadline = time.monotonic() + WAIT_S
        while not told():
            assert time.monotonic() < deadline, "both egos are heard"
            watch.wait(0.05)
        view = watch.view()
    assert [(one.ego, one.selected) for one in view.egos] == [
        ("R1", ("R1", "R2")),
        ("R2", ("R2", "R1")),
    ]
    shown = render(view, ())
    assert "ego  cycle  age" in shown
    assert "R2, R1" in shown
