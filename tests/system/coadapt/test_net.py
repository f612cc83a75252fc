"""`coadapt net` and its make targets: what they ask a controller for, and what they show."""

from __future__ import annotations

import getpass
import json
import os
import shlex
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from coadapt.main import main
from deploy.rates import parse_link_rate, parse_seconds, parse_share
from deploy.spec import make_spec
from deploy.state import State, make_run_dir, write_state
from swarm import keyspace
from swarm.errors import DeployError, NetworkError
from swarm.messages import (
    ClassName,
    LinkClass,
    LinkState,
    NetState,
    ShapeInForce,
    ShapeReply,
    ShapeRequest,
)
from swarm.session import Session
from tests.support.paths import REPOSITORY
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker, wait_until_served

NOW_NS = time.time_ns()


def link_class(rate_bps: int, **values: int) -> LinkClass:
    fields: dict[str, Any] = dict.fromkeys(
        ("throughput_bps", "sent_bytes", "backlog_bytes", "drops", "overlimits"), 0
    )
    fields |= {"rate_bps": rate_bps, "ceil_bps": 5_000_000, "priority": 1}
    return LinkClass(**(fields | values))


def state(seq: int) -> NetState:
    classes: dict[ClassName, LinkClass] = {
        "control": link_class(500_000),
        "fusion": link_class(3_000_000, throughput_bps=2_700_000),
        "background": link_class(1_500_000, backlog_bytes=65_536, drops=1234),
    }
    link = LinkState(
        robot="R1",
        direction="down",
        capacity_bps=5_000_000,
        available_bps=3_500_000,
        latency_ms=12.0,
        level=2,
        classes=classes,
    )
    return NetState(controller=1, seq=seq, sent_ns=NOW_NS, links=(link,))


class Controller:
    """Answers requests as a network controller does, and keeps them."""

    def __init__(self, session: Session, name: str = "") -> None:
        self.requests: list[ShapeRequest] = []
        self.session = session
        self.key = keyspace.net_shape(session.swarm, name)
        session.serve(self.key, ShapeRequest, self._answer, workers=1)

    def _answer(self, request: ShapeRequest) -> ShapeReply:
        self.requests.append(request)
        if request.revision is not None:
            raise NetworkError("the shapes have revision 8, not 7")
        shape = ShapeInForce(
            robot="R1",
            direction="down",
            profile="trace",
            rate_bps=5_000_000,
            operator="ann@floor",
            since_ns=NOW_NS,
            until_ns=NOW_NS + 60 * 10**9,
            delay_ms=20.0,
            loss=0.01,
        )
        return ShapeReply(
            request=request.request,
            revision=8,
            shapes=(shape,),
            congested=("R1",),
            notes=("this replaces the shape of bob",),
        )


@pytest.fixture
def swarm(swarm_name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """Records a swarm with a router's address, as `up` does; gives the swarm's name."""
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))

    def record(router: str) -> str:
        spec = make_spec(swarm=swarm_name, robots=("R1", "R2"), var_dir=str(tmp_path))
        make_run_dir(spec)
        write_state(State(runtime="netns", spec=spec, router=router))
        return swarm_name

    return record


@pytest.fixture
def controller(
    swarm: Callable[[str], str],
    shared_router: RouterProcess,
    open_session: SessionMaker,
    monkeypatch: pytest.MonkeyPatch,
) -> Controller:
    monkeypatch.setattr("coadapt.net_client.GATHER_S", 0.2)
    swarm(shared_router.address)
    controller = Controller(open_session(shared_router.address))
    wait_until_served(
        open_session(shared_router.address), keyspace.net_shape(controller.session.swarm)
    )
    return controller


@pytest.fixture
def halls(
    swarm: Callable[[str], str], shared_router: RouterProcess, open_session: SessionMaker
) -> Iterator[tuple[Controller, Controller]]:
    """The controllers of two hosts: R1, the ego, is on one, R7 on the other, which shapes none."""
    swarm(shared_router.address)
    session = open_session(shared_router.address)
    both = Controller(session, "hall-1"), Controller(session, "hall-2")
    asker = open_session(shared_router.address)
    for one in both:
        wait_until_served(asker, one.key)
    over = threading.Event()

    def publish() -> None:
        seq = 0
        why = ("R7 down: tc refuses to shape eth1",)
        while not over.wait(0.1):
            seq += 1
            here = msgspec.structs.replace(state(seq), name="hall-1", robots=("R1", "R2"))
            there = NetState(
                controller=2, seq=seq, sent_ns=NOW_NS, name="hall-2", robots=("R7",), unshaped=why
            )
            for one in (here, there):
                session.put(keyspace.net_state(session.swarm, one.name), one)

    thread = threading.Thread(target=publish)
    thread.start()
    yield both
    over.set()
    thread.join()


@pytest.mark.parametrize(
    ("argv", "asked"),
    [
        ("shape --rate 5mbit", ("R1", None)),
        ("shape --rate 5mbit --robot R2", ("R2", None)),
        ("shape --rate 5mbit --robot R7 --direction up", (None, "R7")),
        ("congest --stop", ("", "")),
        ("shape --profile off", ("", "")),
        ("shape --profile off --robot R7", (None, "R7")),
    ],
)
def test_a_request_reaches_the_controller_of_the_host_that_has_the_link(
    argv: str, asked: tuple[str | None, ...], halls: tuple[Controller, Controller]
) -> None:
    assert net(halls[0], *argv.split()) == 0
    for one, robot in zip(halls, asked, strict=True):
        assert [request.robot for request in one.requests] == ([] if robot is None else [robot])


def test_a_robot_that_no_host_has_is_told(
    halls: tuple[Controller, Controller], capsys: pytest.CaptureFixture[str]
) -> None:
    assert net(halls[0], "shape", "--rate", "5mbit", "--robot", "R9") == 1
    assert "no network controller has a link of robot 'R9'" in capsys.readouterr().err
    assert not halls[0].requests
    assert not halls[1].requests


def test_show_tells_of_all_hosts(
    halls: tuple[Controller, Controller], capsys: pytest.CaptureFixture[str]
) -> None:
    assert net(halls[0], "show", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert table["revisions"] == {"hall-1": 8, "hall-2": 8}
    assert [link["robot"] for link in table["links"]] == ["R1"]
    assert [(one["name"], one["robots"]) for one in table["controllers"]] == [
        ("hall-1", ["R1", "R2"]),
        ("hall-2", ["R7"]),
    ]
    assert net(halls[0], "show") == 0
    out = capsys.readouterr().out
    assert "note: controller hall-2: R7 down: tc refuses to shape eth1; C(t) is only measu" in out
    assert "controller hall-1: revision 8" in out


def net(controller: Controller, *argv: str) -> int:
    return main(["net", *argv, "--swarm", controller.session.swarm])


@pytest.mark.parametrize(
    ("argv", "wanted"),
    [
        ("shape --rate 5mbit", {"profile": "rate", "rate_bps": 5_000_000, "direction": "down"}),
        (
            "shape --rate 800kbit --robot R2 --direction up --for 10m --delay 20ms --loss 1%",
            {
                "robot": "R2",
                "direction": "up",
                "rate_bps": 800_000,
                "duration_s": 600.0,
                "delay_ms": 20.0,
                "loss": 0.01,
            },
        ),
        (
            "shape --profile shift --time-scale 3600 --direction both",
            {"profile": "shift", "time_scale": 3600.0, "rate_bps": None, "direction": "both"},
        ),
        ("shape --profile off", {"profile": "off", "robot": "", "direction": "both"}),
        (
            "shape --profile off --robot R2 --direction up",
            {"profile": "off", "robot": "R2", "direction": "up"},
        ),
        ("congest", {"profile": "congest", "rate_bps": None, "duration_s": None}),
        (
            "congest --rate 4mbit --for 30s --protocol udp --robot R2",
            {"rate_bps": 4_000_000, "duration_s": 30.0, "protocol": "udp", "robot": "R2"},
        ),
        ("congest --stop", {"profile": "relieve", "robot": ""}),
        ("congest --stop --robot R2", {"profile": "relieve", "robot": "R2"}),
    ],
)
def test_a_command_asks_for_what_was_said(
    argv: str, wanted: dict[str, Any], controller: Controller
) -> None:
    assert net(controller, *argv.split()) == 0
    (request,) = controller.requests
    assert {name: getattr(request, name) for name in wanted} == wanted
    assert request.operator.startswith(f"{getpass.getuser()}@")


def test_a_trace_travels_as_rates(controller: Controller, tmp_path: Path) -> None:
    path = tmp_path / "a trace"
    path.write_text("250\n500\n500\n1000\n")
    argv = ("shape", "--profile", "trace", "--trace", str(path), "--interval", "0.5")
    assert net(controller, *argv, "--time-scale", "2") == 0
    (request,) = controller.requests
    assert (request.profile, request.interval_s, request.time_scale) == ("trace", 0.5, 2.0)
    assert request.rates_bps == (72_000, 24_000)


def test_the_answer_says_what_is_in_force_until_when_and_what_to_know(
    controller: Controller, capsys: pytest.CaptureFixture[str]
) -> None:
    assert net(controller, "shape", "--rate", "5mbit") == 0
    out = capsys.readouterr().out
    assert "R1 down: 5.0 Mbit/s (trace), delay 20 ms, loss 1 % until " in out
    assert "by ann@floor since " in out
    assert "telemetry runs towards R1" in out
    assert "note: this replaces the shape of bob" in out
    assert "revision 8" in out


def test_the_answer_is_one_object_for_programs(
    controller: Controller, capsys: pytest.CaptureFixture[str]
) -> None:
    assert net(controller, "congest", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert table["revision"] == 8
    assert table["congested"] == ["R1"]
    assert table["shapes"][0]["rate_bps"] == 5_000_000
    assert "links" not in table


@pytest.fixture
def publishing(controller: Controller) -> Iterator[None]:
    """A state every moment, as a controller publishes it."""
    over = threading.Event()

    def publish() -> None:
        seq = 0
        while not over.wait(0.05):
            seq += 1
            controller.session.put(keyspace.net_state(controller.session.swarm), state(seq))

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    over.set()
    thread.join()


@pytest.mark.usefixtures("publishing")
def test_show_tells_what_links_carry(
    controller: Controller, capsys: pytest.CaptureFixture[str]
) -> None:
    assert net(controller, "show") == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("R1 down: 5.0 Mbit/s") for line in lines)
    assert "R1 down: capacity 5.0 Mbit/s, 3.5 Mbit/s for fusion, latency 12 ms, level 2" in lines
    rows = {line.split()[0]: line for line in lines if line.startswith("  ")}
    assert "2.7 Mbit/s" in rows["fusion"]
    assert "65,536 B" in rows["background"]
    assert "1,234" in rows["background"]
    assert net(controller, "show", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert table["links"][0]["classes"]["background"]["drops"] == 1234
    assert table["state_ns"] == NOW_NS


def test_show_works_while_no_state_comes(
    controller: Controller, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coadapt.net_client.STATE_S", 0.1)
    assert net(controller, "show") == 0
    assert "no net/state came" in capsys.readouterr().out
    assert net(controller, "show", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert (table["links"], table["state_ns"]) == ([], None)


def test_a_refusal_is_told_in_the_controllers_words(
    controller: Controller, capsys: pytest.CaptureFixture[str]
) -> None:
    assert net(controller, "shape", "--rate", "5mbit", "--if-revision", "7") == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err == "coadapt: the shapes have revision 8, not 7\n"
    assert len(controller.requests) == 1


@pytest.mark.parametrize(
    ("argv", "told"),
    [
        (("shape", "--rate", "5 mbps"), "rate '5 mbps' is not valid; write it like 55mbit"),
        (("shape", "--rate", "5mbps"), "a link may have 32kbit to 10gbit"),
        (("shape", "--rate", "0"), "rate '0' is not valid"),
        (("shape", "--rate", "0mbit"), "rate '0mbit' is not possible; a link may have 32kbit"),
        (("shape", "--rate", "-5mbit"), "rate '-5mbit' is not valid"),
        (("shape", "--rate", "1bit"), "rate '1bit' is not possible"),
        (("shape", "--rate", "1tbit"), "rate '1tbit' is not possible"),
        (("shape", "--rate", "nan"), "rate 'nan' is not valid"),
        (("shape", "--rate", ""), "rate '' is not valid"),
        (("shape", "--rate", "9" * 400 + "mbit"), "is not valid"),
        (("congest", "--rate", "1bit"), "rate '1bit' is not possible"),
        (("shape", "--rate", "5mbit", "--for", "60"), "time '60' is not valid; write it like 60s"),
        (("shape", "--rate", "5mbit", "--for", "999h"), "up to 604800s"),
        (("shape", "--rate", "5mbit", "--for", "-1s"), "time '-1s' is not valid"),
        (("shape", "--rate", "5mbit", "--delay", "1m"), "up to 10s"),
        (("shape", "--rate", "5mbit", "--loss", "51%"), "up to 50%"),
        (("shape", "--rate", "5mbit", "--robot", "R 1"), "robot id 'R 1' is not allowed"),
        (("shape", "--rate", "5mbit", "--if-revision", "-1"), ">= 0 - at `$.revision`"),
        (("shape", "--profile", "shift", "--time-scale", "nan"), "$.time_scale"),
        (("shape", "--profile", "trace", "--trace", "/nowhere"), "trace '/nowhere' cannot be read"),
    ],
)
def test_a_wrong_value_is_an_error_that_says_what_is_allowed(
    argv: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["net", *argv, "--swarm", "nowhere"]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert told in shown.err


@pytest.mark.parametrize(
    "argv",
    [
        "",
        "shape",
        "shape --rate 5mbit --profile shift",
        "shape --profile rate",
        "shape --profile trace",
        "shape --rate 5mbit --trace file",
        "shape --profile shift --interval 2",
        "shape --rate 5mbit --time-scale 2",
        "shape --profile off --for 10s",
        "shape --profile off --delay 10ms",
        "shape --rate 5mbit --direction sideways",
        "congest --protocol sctp",
        "congest --stop --rate 4mbit",
        "congest --stop --for 30s",
        "show --rate 5mbit",
    ],
)
def test_options_that_do_not_belong_together_are_wrong_usage(
    argv: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["net", *argv.split()])
    assert ended.value.code == 2
    assert "usage: " in capsys.readouterr().err


def test_without_a_controller_the_command_says_so(
    swarm: Callable[[str], str],
    shared_router: RouterProcess,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("coadapt.asking.FIND_S", 0.3)
    name = swarm(shared_router.address)
    assert main(["net", "show", "--swarm", name]) == 1
    assert f"no network controller answers in swarm '{name}'" in capsys.readouterr().err


def test_without_a_router_the_command_says_so(
    swarm: Callable[[str], str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("coadapt.commands.net.CONNECT_S", 0.3)
    name = swarm("tcp/127.0.0.1:9")
    assert main(["net", "shape", "--rate", "5mbit", "--swarm", name]) == 1
    assert f"the router of swarm '{name}' does not answer" in capsys.readouterr().err


def test_without_a_swarm_the_command_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    assert main(["net", "show", "--swarm", "nowhere"]) == 1
    assert "no swarm 'nowhere' is running" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "argv"),
    [
        ("shape RATE=5mbit", "shape --swarm local --rate 5mbit"),
        ("shape 'RATE=5 mbps'", "shape --swarm local --rate '5 mbps'"),
        (
            "shape RATE=5mbit ROBOT=R3 DIRECTION=up DURATION=60s SWARM=hall",
            "shape --swarm hall --rate 5mbit --robot R3 --direction up --for 60s",
        ),
        (
            "shape PROFILE=shift TIME_SCALE=3600",
            "shape --swarm local --profile shift --time-scale 3600",
        ),
        (
            "shape PROFILE=trace 'TRACE=my trace' ARGS='--interval 2'",
            "shape --swarm local --profile trace --trace 'my trace' --interval 2",
        ),
        ("shape PROFILE=off", "shape --swarm local --profile off"),
        ("shape", "shape --swarm local"),
        ("congest", "congest --swarm local"),
        (
            "congest RATE=4mbit DURATION=30s ROBOT=R2",
            "congest --swarm local --rate 4mbit --robot R2 --for 30s",
        ),
        ("congest ARGS=--stop", "congest --swarm local --stop"),
        ("net ARGS=--json", "show --swarm local --json"),
    ],
)
def test_make_says_the_same_to_the_command_line(line: str, argv: str) -> None:
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    done = subprocess.run(
        ["make", "--dry-run", "--no-print-directory", *shlex.split(line)],
        cwd=REPOSITORY,
        # Variables of a make that runs the tests are not meant.
        env={"PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
        check=True,
    )
    said = shlex.split(done.stdout.replace("\\\n", " "))
    assert said[said.index("net") + 1 :] == shlex.split(argv)


def test_times_and_shares_are_read_as_people_write_them() -> None:
    assert [parse_seconds(text, 1e5) for text in ("60s", "1.5h", "10m", "20ms", " 2S ")] == [
        60.0,
        5400.0,
        600.0,
        0.02,
        2.0,
    ]
    assert [parse_share(text) for text in ("1%", "0.5%", "100%", "0%")] == [0.01, 0.005, 1.0, 0.0]
    assert [parse_link_rate(text) for text in ("32kbit", "10gbit")] == [32_000, 10**10]


@pytest.mark.parametrize("text", ["", "1", "101%", "-1%", "nan%", "1 %"])
def test_other_shares_are_refused(text: str) -> None:
    with pytest.raises(DeployError, match="write it like 1%"):
        parse_share(text)
