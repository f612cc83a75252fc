"""Who may see the console and who may steer with it."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from options.console.app import PAGE
from options.console.settings import ConsoleSettings, load_settings
from swarm import keyspace
from swarm.errors import NetworkError, SettingError
from swarm.http.hosts import Hosts
from swarm.messages import (
    EgoSteered,
    EgoSteering,
    EgoWish,
    RobotSteered,
    RobotSteering,
    ShapeInForce,
    ShapeReply,
    ShapeRequest,
)
from tests.support.console_swarm import WAIT_S, Speakers, Viewer, ask, console
from tests.support.free_ports import free_port
from tests.support.zenoh_fixtures import (
    Inbox,
    RouterProcess,
    SessionMaker,
    until,
    wait_until_served,
)

TOKEN = "open-sesame"


@pytest.fixture
def port(shared_router: RouterProcess, swarm_name: str) -> Iterator[int]:
    with console(shared_router.address, swarm_name) as port:
        yield port


@pytest.fixture(scope="module")
def open_endpoint(shared_router: RouterProcess) -> Iterator[int]:
    """A console for tests that ask nothing of the swarm."""
    with console(shared_router.address, "endpoints-open") as port:
        yield port


@pytest.fixture(scope="module")
def guarded(shared_router: RouterProcess) -> Iterator[int]:
    with console(shared_router.address, "endpoints-guarded", console_token=TOKEN) as port:
        yield port


@pytest.fixture
def asked(
    shared_router: RouterProcess, open_session: SessionMaker, swarm_name: str
) -> Inbox[ShapeRequest]:
    """What reached a queryable that answers as the network controller does."""
    inbox: Inbox[ShapeRequest] = Inbox()

    def shape(request: ShapeRequest) -> ShapeReply:
        inbox.put(request)
        if request.robot == "R9":
            raise NetworkError("robot 'R9' is not here; there are R1, R2")
        made = ShapeInForce(
            robot=request.robot or "R1",
            direction="down",
            profile=request.profile,
            rate_bps=request.rate_bps or 0,
            operator=request.operator,
            since_ns=1,
            until_ns=0,
        )
        return ShapeReply(request=request.request, revision=1, shapes=(made,))

    key = keyspace.net_shape(swarm_name)
    open_session(shared_router.address).serve(key, ShapeRequest, shape)
    wait_until_served(open_session(shared_router.address), key)
    return inbox


@pytest.fixture
def viewer(port: int) -> Iterator[Viewer]:
    with Viewer(port) as viewer:
        viewer.until(lambda: viewer.state["swarm"]["connected"], "the swarm is there")
        yield viewer


def test_a_shape_reaches_the_network_controller(viewer: Viewer, asked: Inbox[ShapeRequest]) -> None:
    done = viewer.shape({"profile": "rate", "rate_bps": 2_000_000, "robot": "R2", "duration_s": 60})
    assert done.status == 200, done
    request = asked.next()
    assert (request.profile, request.rate_bps, request.robot) == ("rate", 2_000_000, "R2")
    assert (request.duration_s, request.operator) == (60.0, "console")
    assert b'"rate_bps":2000000' in done.body
    declared = {"Content-Type": "Application/JSON; charset=utf-8"}
    assert viewer.shape({"profile": "off"}, **declared).status == 200


@pytest.mark.parametrize("profile", ["congest", "relieve", "off", "shift", "show"])
def test_so_do_the_other_wishes(viewer: Viewer, asked: Inbox[ShapeRequest], profile: str) -> None:
    assert viewer.shape({"profile": profile}).status == 200
    assert asked.next().profile == profile


def test_policy_and_q_min_reach_the_ego_and_a_robots_duty_the_robot(
    viewer: Viewer, shared_router: RouterProcess, open_session: SessionMaker, swarm_name: str
) -> None:
    inbox: Inbox[EgoSteering | RobotSteering] = Inbox()

    def ego(request: EgoSteering) -> EgoSteered:
        inbox.put(request)
        return EgoSteered(request=0, ego="R1", policy="static-late", q_min=0.6, policies=("a",))

    def robot(request: RobotSteering) -> RobotSteered:
        inbox.put(request)
        return RobotSteered(request=0, robot="R2", on_duty=False, operator=request.operator)

    served = open_session(shared_router.address)
    keys = keyspace.ego_steering(swarm_name, "R1"), keyspace.robot_steering(swarm_name, "R2")
    served.serve(keys[0], EgoSteering, ego)
    served.serve(keys[1], RobotSteering, robot)
    asker = open_session(shared_router.address)
    for key in keys:
        wait_until_served(asker, key)
    done = viewer.post("ego", {"wish": {"policy": "static-late", "q_min": 0.6}})
    assert done.status == 200, done
    assert inbox.next() == EgoSteering(
        operator="console", wish=EgoWish(policy="static-late", q_min=0.6)
    )
    assert b'"policy":"static-late"' in done.body
    assert viewer.post("robot/R2", {"duty": "off"}).status == 200
    assert inbox.next() == RobotSteering(operator="console", duty="off")
    assert viewer.post("robot/R*2", {"duty": "off"}).status == 400
    assert viewer.post("ego", {"wish": {"q_min": 2}}).status == 400
    assert viewer.post("nothing", {}).status == 404
    assert inbox.empty()


def test_a_robot_that_was_taken_off_duty_is_told_from_one_that_is_lost(
    viewer: Viewer, shared_router: RouterProcess, open_session: SessionMaker, swarm_name: str
) -> None:
    def steered(request: RobotSteering) -> RobotSteered:
        return RobotSteered(request=0, robot="R2", on_duty=False, operator="ada@desk")

    served = open_session(shared_router.address)
    key = keyspace.robot_steering(swarm_name, "R2")
    served.serve(key, RobotSteering, steered)
    wait_until_served(open_session(shared_router.address), key)
    withdraw = served.declare_alive("R2")
    viewer.until(lambda: viewer.state.get("robot/R2", {}).get("alive"), "R2 is there")
    withdraw()
    viewer.until(lambda: viewer.state["robot/R2"]["off_duty_by"] == "ada@desk", "why it left")
    told = "R2 was taken off duty by ada@desk"
    viewer.until(lambda: any(fault["text"] == told for fault in viewer.faults), "the event")


def test_a_page_may_not_speak_in_another_operators_name(
    viewer: Viewer, asked: Inbox[ShapeRequest]
) -> None:
    assert viewer.shape({"profile": "off", "operator": "somebody"}).status == 200
    assert asked.next().operator == "console"


def test_the_controllers_refusal_is_told_in_its_words(
    viewer: Viewer, asked: Inbox[ShapeRequest]
) -> None:
    refused = viewer.shape({"profile": "rate", "rate_bps": 2_000_000, "robot": "R9"})
    assert (refused.status, refused.error) == (409, "robot 'R9' is not here; there are R1, R2")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"profile": "rate", "rate_bps": 5}, "rate_bps"),
        ({"profile": "fast"}, "profile"),
        ({}, "profile"),
        ("{", "truncated"),
        ("[1]", "object"),
        ('{"a":' + "[" * 100_000, "recursion"),
    ],
)
def test_a_wish_that_is_not_valid_is_named_and_reaches_nobody(
    viewer: Viewer, asked: Inbox[ShapeRequest], body: object, words: str
) -> None:
    refused = viewer.shape(body)
    assert refused.status == 400
    assert words in refused.error
    assert asked.empty()


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"X-CoAdapt-CSRF": ""}, 403),
        ({"X-CoAdapt-CSRF": "guessed"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": ""}, 403),
        ({"Origin": "http://["}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Content-Type": "text/plain"}, 415),
        ({"Host": "evil.example"}, 421),
    ],
)
def test_a_control_from_elsewhere_is_refused(
    viewer: Viewer, asked: Inbox[ShapeRequest], headers: dict[str, str], status: int
) -> None:
    assert viewer.shape({"profile": "off"}, **headers).status == status
    assert asked.empty()


def test_the_token_of_a_page_that_is_closed_controls_nothing(open_endpoint: int) -> None:
    with Viewer(open_endpoint) as closed:
        closed.next()
    with Viewer(open_endpoint) as other:
        other.next()
        assert other.csrf != closed.csrf
        other.until(lambda: closed.shape({"profile": "off"}).status == 403, "it is forgotten")


def test_without_a_controller_the_page_is_told(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("options.console.watch.ANSWER_S", 0.3)
    refused = viewer.shape({"profile": "off"})
    assert refused.status == 504
    assert "does not answer" in refused.error


def test_the_page_is_whole_and_may_load_nothing_from_elsewhere(open_endpoint: int) -> None:
    page = ask(open_endpoint, "GET", "/")
    assert page.status == 200
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'; script-src 'self'" in policy
    assert "unsafe" not in policy
    # Without a referrer a browser sends the login form without its origin.
    assert page.headers["referrer-policy"] == "same-origin"
    for file in PAGE.iterdir():
        if file.suffix != ".html":
            got = ask(open_endpoint, "GET", f"/assets/{file.name}")
            assert (got.status, got.body) == (200, file.read_bytes())
            assert got.headers["x-content-type-options"] == "nosniff"
        for mark in ("https://", "<script>", "style=", "onclick"):
            assert mark not in file.read_text(), (file.name, mark)


def dripped(connection: socket.socket, byte: bytes) -> None:
    """Sends a byte now and then until the server has let go."""
    connection.settimeout(0.05)

    def gone() -> bool:
        try:
            connection.sendall(byte)
            return connection.recv(4096) == b""
        except TimeoutError:
            return False
        except ConnectionError:
            return True

    until(gone, "the server lets go")


@pytest.mark.parametrize(
    ("begun", "byte"),
    [
        (b"", b""),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ", b"x"),
        (b"POST /api/shape HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999\r\n\r\n", b"x"),
    ],
)
def test_who_never_sends_a_whole_request_keeps_no_place(
    shared_router: RouterProcess,
    swarm_name: str,
    monkeypatch: pytest.MonkeyPatch,
    begun: bytes,
    byte: bytes,
) -> None:
    monkeypatch.setattr("swarm.http.serving.REQUEST_S", 0.3)
    with (
        console(shared_router.address, swarm_name, console_token=TOKEN) as port,
        socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as connection,
        Viewer(port, Authorization=f"Bearer {TOKEN}") as viewer,
    ):
        connection.sendall(begun)
        dripped(connection, byte)
        # Nobody else is hurried: this one has sent all of his request.
        for _ in range(3):
            viewer.next()


def held(port: int, peer: int) -> bool:
    """Whether the kernel still has the server's end of a connection."""
    ends = [line.split()[1:3] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    ports = [[int(end.rpartition(":")[2], 16) for end in pair] for pair in ends]
    return [port, peer] in ports


def test_a_viewer_who_takes_nothing_is_let_go_with_all_that_waits_for_him(
    shared_router: RouterProcess,
    swarm_name: str,
    open_session: SessionMaker,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("swarm.http.serving.UNTAKEN_S", 1.0)
    monkeypatch.setattr("swarm.http.events.STALLED_S", 0.5)
    speakers = Speakers(open_session(shared_router.address))
    with (
        console(shared_router.address, swarm_name) as port,
        socket.socket() as stalled,
        Viewer(port) as other,
    ):
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.connect(("127.0.0.1", port))
        stalled.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        peer = stalled.getsockname()[1]
        assert held(port, peer)

        def let_go() -> bool:
            speakers.decision(1, "R1", reason="x" * 1000)
            other.next()
            return not held(port, peer)

        until(let_go, "the stalled one is let go")


@pytest.mark.parametrize("path", ["/assets/../app.py", "/assets/%2e%2e/app.py", "/nothing"])
def test_nothing_else_is_served(open_endpoint: int, path: str) -> None:
    assert ask(open_endpoint, "GET", path).status == 404


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "10.0.0.1", "", "[::"])
def test_a_name_that_somebody_had_lead_here_is_refused(open_endpoint: int, host: str) -> None:
    for path in ("/", "/api/events", "/api/floor"):
        assert ask(open_endpoint, "GET", path, Host=host).status == 421


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:9", "127.0.0.1:8080", "[::1]:8080"])
def test_this_hosts_own_names_are_answered(open_endpoint: int, host: str) -> None:
    assert ask(open_endpoint, "GET", "/api/floor", Host=host).status == 200


def test_off_this_host_addresses_are_answered_and_names_that_were_set() -> None:
    hosts = Hosts(("Console.Plant",), loopback=False)
    assert hosts.may("192.168.1.7:8080")
    assert hosts.may("console.plant")
    assert not hosts.may("evil.example")


@pytest.mark.parametrize(
    "headers",
    [{}, {"Authorization": "Bearer wrong"}, {"Cookie": "coadapt_console=wrong"}, {"Cookie": "="}],
)
def test_without_the_token_nothing_of_the_swarm_is_shown(
    guarded: int, headers: dict[str, str]
) -> None:
    for method, path in (("GET", "/api/events"), ("GET", "/api/floor"), ("POST", "/api/shape")):
        assert ask(guarded, method, path, **headers).status == 401
    page = ask(guarded, "GET", "/", **headers)
    assert (page.status, page.headers["location"]) == (303, "/login")
    assert ask(guarded, "GET", "/login").status == 200


def test_the_token_opens_as_a_header_and_as_a_form(
    guarded: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("options.console.app.WRONG_TOKEN_S", 0.0)
    assert ask(guarded, "GET", "/api/floor", Authorization=f"Bearer {TOKEN}").status == 200
    origin = f"http://127.0.0.1:{guarded}"
    wrong = ask(guarded, "POST", "/login", "token=wrong", Origin=origin)
    assert wrong.status == 401
    assert "set-cookie" not in wrong.headers
    elsewhere = ask(guarded, "POST", "/login", f"token={TOKEN}", Origin="http://evil.example")
    assert elsewhere.status == 403
    right = ask(guarded, "POST", "/login", f"token={TOKEN}", Origin=origin)
    assert right.status == 303
    set_cookie = right.headers["set-cookie"]
    assert "HttpOnly" in set_cookie
    assert "SameSite=strict" in set_cookie
    assert TOKEN not in set_cookie
    cookie = set_cookie.split(";")[0]
    assert ask(guarded, "GET", "/", Cookie=cookie).status == 200
    with Viewer(guarded, Cookie=cookie) as viewer:
        viewer.next()


def test_off_this_host_a_token_is_needed() -> None:
    from options.console.endpoint import Endpoint

    with pytest.raises(SettingError, match="COADAPT_CONSOLE_TOKEN is not set"):
        Endpoint(ConsoleSettings(ego="R1", console_host="0.0.0.0", console_port=0))
    with pytest.raises(SettingError, match="COADAPT_CONSOLE_TOKEN is not valid"):
        Endpoint(ConsoleSettings(ego="R1", console_port=0, console_token="two words"))


def test_the_token_stands_in_no_message_about_settings() -> None:
    settings = load_settings({"COADAPT_EGO": "R1", "COADAPT_CONSOLE_TOKEN": TOKEN})
    assert settings.console_token == TOKEN
    assert TOKEN not in repr(settings)


def metrics(port: int) -> dict[str, float]:
    text = ask(port, "GET", "/metrics").body.decode()
    return {
        sample.name: sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_the_process_serves_and_ends_on_a_signal_with_a_page_open(
    shared_router: RouterProcess, swarm_name: str, tmp_path: Path
) -> None:
    port, metrics_port = free_port(), free_port()
    environment = os.environ | {
        "COADAPT_ROUTER": shared_router.address,
        "COADAPT_SWARM": swarm_name,
        "COADAPT_EGO": "R1",
        "COADAPT_CONSOLE_PORT": str(port),
        "COADAPT_CONSOLE_TOKEN": TOKEN,
        "COADAPT_METRICS_PORT": str(metrics_port),
    }
    with subprocess.Popen(
        [sys.executable, "-m", "options.console"],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        first = process.stderr.readline()
        assert "console_up" in first, first
        try:
            with Viewer(port, Authorization=f"Bearer {TOKEN}") as viewer:
                viewer.until(lambda: viewer.state["swarm"]["connected"], "the swarm is there")
                # Events count once they are sent: a viewer may have one before that.
                until(lambda: metrics(metrics_port)["coadapt_console_events_total"] >= 1, "counts")
                shown = metrics(metrics_port)
                assert shown["coadapt_console_viewers"] == 1
                assert shown["coadapt_console_connected"] == 1
                assert math.isnan(shown["coadapt_console_decision_age_seconds"])
                # Prometheus has an endpoint of its own: the page's shows nothing without the token.
                assert ask(port, "GET", "/metrics").status == 401
                process.send_signal(signal.SIGTERM)
                log = first + process.stderr.read()
                assert process.wait(WAIT_S) == 0, log
        finally:
            process.kill()
    assert TOKEN not in log


def test_a_wrong_setting_ends_the_process_with_its_name() -> None:
    environment = os.environ | {"COADAPT_EGO": "R1", "COADAPT_CONSOLE_PORT": "high"}
    done = subprocess.run(
        [sys.executable, "-m", "options.console"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert done.returncode == 1
    assert "COADAPT_CONSOLE_PORT = 'high'" in done.stderr
