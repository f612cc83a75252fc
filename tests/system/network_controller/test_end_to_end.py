"""A swarm whose links the controller shapes: decisions follow, and bandwidth moves when they
cannot."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.paths import net_journal_path
from deploy.ready import wait_ready
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import State, need_state
from deploy.view import SwarmView
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port
from tests.support.paths import REPOSITORY

READY_S = 120.0
_refused = launch.why_not()
pytestmark = [
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
    pytest.mark.skipif(shutil.which("tc") is None, reason="tc is not installed"),
]
Net = Callable[..., Any]


@pytest.fixture(scope="module")
def swarm() -> Iterator[State]:
    """Six robots, an ego that only early fusion of most of them satisfies, and a controller that
    acts after three windows of one second."""
    with (
        tempfile.TemporaryDirectory(prefix="cn-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", f"{directory}/run")
        patch.setenv("COADAPT_WINDOW_S", "1")
        # At a fixed pace: an ego that learns slows down instead of asking for more of the link.
        patch.setenv("COADAPT_LEARN", "false")
        # In every frame: an ego that remembers asks less often instead.
        patch.setenv("COADAPT_RARER", "false")
        # Whoever adds anything is asked.
        patch.setenv("COADAPT_LINK_WEIGHT", "0")
        patch.setenv("COADAPT_COMPUTE_WEIGHT", "0")
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        spec = make_spec(
            swarm="links",
            robots=factory_robots(6),
            q_min=0.79,
            prometheus=False,
            ego_metrics_port=free_port(),
            qod_port=free_port(),
            var_dir=f"{directory}/var",
        )
        runtime = NetnsRuntime()
        assert runtime.up(spec)
        try:
            wait_ready(runtime, need_state(spec.swarm), READY_S)
            yield need_state(spec.swarm)
        finally:
            runtime.down(spec.swarm)


@pytest.fixture
def net(swarm: State) -> Iterator[Net]:
    """Runs `coadapt net`; nothing that it shaped stays."""

    def run(*arguments: str, fails: bool = False) -> Any:
        done = subprocess.run(
            [
                *(sys.executable, "-m", "coadapt.main", "net", *arguments),
                *("--swarm", swarm.spec.swarm, "--json"),
            ],
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert (done.returncode != 0) == fails, done.stderr
        return done.stderr if fails else json.loads(done.stdout)

    yield run
    run("shape", "--profile", "off")


@pytest.fixture
def watch(swarm: State) -> Iterator[Watch]:
    with Watch(swarm, timeout_s=30.0) as watch:
        yield watch


def rich(view: SwarmView) -> bool:
    """Points of many robots."""
    return view.algorithm == "early" and len(view.selected or ()) >= 4


def several(view: SwarmView) -> bool:
    """Points of more robots than 15 % of the link can carry, and fewer than all of fusion's share:
    where robots lack processor time, not all of them are in time."""
    return view.algorithm == "early" and len(view.selected or ()) >= 3


def actions(spec: SwarmSpec, *kinds: str) -> list[dict[str, Any]]:
    """Lines of the controller's journal."""
    lines = Path(net_journal_path(spec, spec.var_dir)).read_text().splitlines()
    return [line for line in map(json.loads, lines) if line["action"] in kinds]


def steps(spec: SwarmSpec) -> list[tuple[str, int]]:
    """What the slow loop has done, and the level that it led to."""
    return [(line["action"], line["level"]) for line in actions(spec, "raised", "lowered")]


def cell(net: Net, like: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The state of the cell, once it is published and is like that."""

    def found() -> dict[str, Any] | None:
        for link in net("show")["links"]:
            if (link["robot"], link["direction"]) == ("R1", "down") and like(link):
                return dict(link)
        return None

    state = await_(found, "the cell is shaped as it should be")
    assert state is not None
    return state


def test_a_smaller_link_gets_a_decision_that_fits_and_a_wider_one_the_richer_back(
    net: Net, watch: Watch
) -> None:
    net("shape", "--rate", "55mbit")
    await_(lambda: rich(watch.view()), "points of many robots on a wide link")
    net("shape", "--rate", "500kbit")

    def announcements() -> SwarmView | None:
        view = watch.view()
        return view if view.capacity_bps is not None and view.capacity_bps <= 5e5 else None

    knows = await_(announcements, "a decision that knows of the smaller link")
    assert knows is not None
    assert knows.algorithm == "late" or len(knows.selected or ()) < 4
    assert knows.valid
    net("shape", "--rate", "55mbit")
    await_(lambda: rich(watch.view()), "the richer decision is back")


def test_a_busy_machine_is_not_taken_for_a_narrow_link(net: Net, watch: Watch) -> None:
    """Robots, ego and this test share few processors, so that answers come late."""
    for rate, rate_bps in (("20mbit", 20e6), ("55mbit", 55e6)):
        net("shape", "--rate", rate)
        await_(lambda bps=rate_bps: near(watch.view(), bps), "C(t) is what was configured")  # type: ignore[misc]
        cycles: set[int | None] = set()
        while len(cycles) < 8:
            view = watch.view()
            assert near(view, rate_bps), view
            cycles.add(view.cycle)
            time.sleep(0.2)


def near(view: SwarmView, rate_bps: float) -> bool:
    """C(t) is the rate, less what control takes."""
    return view.capacity_bps is not None and 0.85 * rate_bps <= view.capacity_bps <= rate_bps


def test_telemetry_that_fills_the_link_makes_the_controller_put_fusion_first(
    swarm: State, net: Net, watch: Watch
) -> None:
    """The paper's third motivating snapshot: telemetry takes 85 % of the link."""
    before = len(steps(swarm.spec))
    net("shape", "--rate", "1500kbit")
    await_(lambda: rich(watch.view()) and watch.cell(), "points of many robots fit 1.5 Mbit/s")
    net("congest", "--for", "600s")
    # Under telemetry the points of all do not fit, and boxes do not reach Q_min...
    await_(
        lambda: not rich(watch.view()) or steps(swarm.spec)[before:],
        "a decision that leaves room for telemetry, or the controller was quicker",
    )
    # ...until the controller puts fusion first.
    await_(lambda: steps(swarm.spec)[before:], "the controller moves the link's level")
    await_(lambda: several(watch.view()), "the points of several fit beside telemetry")
    raised = cell(net, lambda k: k["level"] > 0)["classes"]
    assert raised["fusion"]["priority"] < raised["background"]["priority"]
    assert cell(net, lambda k: k["classes"]["background"]["throughput_bps"] > 300_000)
    after = net("congest", "--stop")
    assert after["congested"] == []
    assert [shape["rate_bps"] for shape in after["shapes"]] == [1_500_000]
    assert steps(swarm.spec)[before] == ("raised", 1)
    assert "Q_min 0.79" in actions(swarm.spec, "raised", "lowered")[before]["reason"]


def test_what_was_moved_comes_back_when_telemetry_ends(
    swarm: State, net: Net, watch: Watch
) -> None:
    before = len(steps(swarm.spec))
    net("shape", "--rate", "1500kbit")
    await_(lambda: rich(watch.view()) and watch.cell(), "points of many robots fit 1.5 Mbit/s")
    net("congest", "--for", "600s")
    await_(lambda: ("raised", 1) in steps(swarm.spec)[before:], "the controller raises the level")
    net("congest", "--stop")
    await_(lambda: steps(swarm.spec)[-1] == ("lowered", 0), "the controller gives back", READY_S)
    assert cell(net, lambda k: k["level"] == 0)
    await_(lambda: rich(watch.view()), "points of many robots")


def test_a_robot_that_is_slow_alone_costs_only_itself(net: Net, watch: Watch) -> None:
    net("shape", "--rate", "55mbit")
    net("shape", "--robot", "R3", "--direction", "up", "--rate", "100kbit")
    states = await_(lambda: net("show").get("links"), "states")
    assert states is not None

    def others_go_on() -> bool:
        view = watch.view()
        return rich(view) and view.frames_per_s > 3

    await_(others_go_on, "the other robots' points are fused")


def test_a_controller_that_is_killed_finds_its_links_again(
    swarm: State, net: Net, watch: Watch
) -> None:
    net("shape", "--rate", "4mbit")
    runtime = NetnsRuntime()
    runtime.kill(swarm.spec.swarm, "controller", signal.SIGKILL)
    await_(lambda: actions(swarm.spec, "adopted"), "the next controller adopts the cell")
    shapes = net("show")["shapes"]
    assert [(s["robot"], s["rate_bps"]) for s in shapes] == [("R1", 4_000_000)]
    assert cell(net, lambda k: k["capacity_bps"] == 4_000_000)


def test_a_shape_that_expires_gives_the_link_back(net: Net, watch: Watch) -> None:
    net("shape", "--rate", "55mbit")
    assert net("shape", "--rate", "1mbit", "--for", "2s")["shapes"][0]["until_ns"] > 0
    await_(lambda: net("show")["shapes"][0]["until_ns"] == 0, "the shape has expired")
    assert cell(net, lambda k: k["capacity_bps"] == 55_000_000)


def test_two_operators_do_not_undo_each_other(net: Net) -> None:
    seen = net("show")["revision"]
    first = net("shape", "--rate", "8mbit", "--if-revision", str(seen))
    why = net("shape", "--rate", "9mbit", "--if-revision", str(seen), fails=True)
    assert f"revision {first['revision']}, not {seen}" in why
    assert net("show")["shapes"][0]["rate_bps"] == 8_000_000


def qod(swarm: State, method: str, path: str, body: object = None) -> tuple[int, Any]:
    """One request of a Quality-on-Demand client."""
    request = urllib.request.Request(
        f"{swarm.qod_url}/quality-on-demand/v1{path}",
        method=method,
        data=json.dumps(body).encode() if body is not None else None,
        headers={"Content-Type": "application/json"},
    )
    try:
        with urllib.request.urlopen(request, timeout=20) as reply:
            return reply.status, json.loads(reply.read() or b"null")
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.loads(error.read())


def test_a_quality_on_demand_session_raises_and_releases_priority_for_real(
    swarm: State, net: Net
) -> None:
    address = "10.77.1.1"
    wish = {
        "device": {"ipv4Address": {"publicAddress": address, "privateAddress": address}},
        "applicationServer": {"ipv4Address": "10.77.0.1"},
        "qosProfile": "QOS_L",
        "duration": 600,
    }
    status, why = qod(swarm, "POST", "/sessions", wish)
    assert (status, why["code"]) == (422, "SERVICE_NOT_APPLICABLE"), "its link is not shaped"
    net("shape", "--rate", "20mbit")
    status, session = qod(swarm, "POST", "/sessions", wish)
    assert (status, session["qosStatus"]) == (201, "AVAILABLE")
    held = cell(net, lambda k: k["level"] == 3)
    classes = held["classes"]
    assert classes["fusion"]["priority"] < classes["background"]["priority"]
    assert classes["fusion"]["rate_bps"] == 9_000_000
    status, _ = qod(swarm, "DELETE", f"/sessions/{session['sessionId']}")
    assert status == 204
    classes = cell(net, lambda k: k["level"] == 0)["classes"]
    assert classes["fusion"]["priority"] == classes["background"]["priority"]
    assert classes["fusion"]["rate_bps"] == 5_000_000
    assert len(actions(swarm.spec, "held", "released")) == 2


def test_a_session_ends_when_its_link_is_not_shaped_any_more(swarm: State, net: Net) -> None:
    net("shape", "--rate", "20mbit")
    address = {"publicAddress": "10.77.1.1", "privateAddress": "10.77.1.1"}
    wish = {
        "device": {"ipv4Address": address},
        "applicationServer": {"ipv4Address": "10.77.0.1"},
        "qosProfile": "QOS_M",
        "duration": 600,
    }
    _, session = qod(swarm, "POST", "/sessions", wish)
    net("shape", "--profile", "off")

    def ended() -> bool:
        _, now = qod(swarm, "GET", f"/sessions/{session['sessionId']}")
        return (now["qosStatus"], now.get("statusInfo")) == ("UNAVAILABLE", "NETWORK_TERMINATED")

    await_(ended, "the session is terminated by the network")
    qod(swarm, "DELETE", f"/sessions/{session['sessionId']}")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("shape", "--rate", "5 mbps"), "write it like 55mbit"),
        (("shape", "--rate", "0mbit"), "32kbit to 10gbit"),
        (("shape", "--rate=-5mbit"), "write it like 55mbit"),
        (("shape", "--rate", "1bit"), "32kbit to 10gbit"),
        (("shape", "--rate", "1tbit"), "32kbit to 10gbit"),
        (("shape", "--rate", "5mbit", "--robot", "R9"), "there are R1, R2, R3, R4, R5, R6"),
        (("congest", "--robot", "R2"), "is not shaped"),
        (("congest", "--rate", "2gbit"), "cannot be made"),
        (("congest", "--rate", "1mbit", "--for", "3h"), "3600"),
    ],
)
def test_a_request_that_makes_no_sense_changes_nothing(
    net: Net, arguments: tuple[str, ...], words: str
) -> None:
    before = net("show")
    assert words in net(*arguments, fails=True)
    after = net("show")
    assert (before["revision"], before["shapes"]) == (after["revision"], after["shapes"])


def test_a_kernel_without_netem_says_so(net: Net) -> None:
    done = subprocess.run(
        [
            *("unshare", "--user", "--map-root-user", "--net", "sh", "-c"),
            "ip link add a type veth peer name b && tc qdisc add dev a root netem delay 1ms",
        ],
        capture_output=True,
    )
    if done.returncode == 0:
        assert net("shape", "--rate", "5mbit", "--delay", "20ms")["shapes"][0]["delay_ms"] == 20
    else:
        assert "netem" in net("shape", "--rate", "5mbit", "--delay", "20ms", fails=True)
