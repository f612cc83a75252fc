"""A named interface of a host, shaped by the real `tc`: only what was asked for, and only for as
long as somebody asks."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from network_controller import ladder
from network_controller.drivers.interface import InterfaceDriver
from network_controller.model import ClassShape, Link, LinkShape
from swarm import keyspace
from swarm.errors import LinkGoneError, NetworkError, RefusedError, SettingError
from swarm.messages import NetState, ShapeReply, ShapeRequest
from swarm.session import Session
from swarm.traffic import TrafficClass
from tests.support.deploy_support import await_
from tests.support.link_support import entered, must, need_namespaces, receive_in
from tests.support.paths import REPOSITORY
from tests.support.zenoh_fixtures import Inbox, RouterProcess, SessionMaker

RATE = 50_000_000
OWN, ROBOT, OTHER = "10.88.0.1", "10.88.0.7", "10.88.0.8"
BEYOND = f"R7={ROBOT}"
HERE = "R1"
"""Without an address it has the interface's own."""


@dataclass(frozen=True, slots=True)
class Host:
    """This thread's namespace: `eth1` leads to a machine with two addresses."""

    patch: pytest.MonkeyPatch
    folder: Path
    beyond: str
    drivers: list[InterfaceDriver] = field(default_factory=list)

    @property
    def state(self) -> Path:
        return self.folder / "interface.json"

    def driver(self, robots: str = BEYOND, interface: str = "eth1") -> InterfaceDriver:
        """A driver as a controller has just made it and looked around."""
        for name, value in self.environment(robots, interface).items():
            self.patch.setenv(name, value)
        driver = InterfaceDriver("qa")
        self.drivers.append(driver)
        driver.robots()
        return driver

    def environment(self, robots: str = BEYOND, interface: str = "eth1") -> dict[str, str]:
        return {
            "COADAPT_INTERFACE": interface,
            "COADAPT_INTERFACE_ROBOTS": robots,
            "COADAPT_INTERFACE_STATE": str(self.state),
        }

    def kernel(self) -> str:
        """All that `tc` and `ip` show of this namespace, without counters and own numbers."""
        shown = must("tc", "qdisc", "show")
        for name in sorted(self.interfaces()):
            shown += f"{name}\n"
            for way in ("egress", "ingress"):
                asked = subprocess.run(
                    ["tc", "filter", "show", "dev", name, way], capture_output=True, text=True
                )
                shown += asked.stdout
        return shown

    def interfaces(self) -> list[str]:
        return os.listdir("/proc/thread-self/net/dev_snmp6")


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Host]:
    need_namespaces()
    mark = f"i{os.getpid()}"
    with ExitStack() as stack:
        for name in (f"{mark}-host", f"{mark}-far"):
            must("ip", "netns", "add", name)
            stack.callback(must, "ip", "netns", "del", name)
        stack.enter_context(entered(f"{mark}-host"))
        must("ip", "link", "set", "lo", "up")
        far = ("ip", "-n", f"{mark}-far")
        for own in ("eth0", "eth1"):
            must("ip", "link", "add", own, "type", "veth", "peer", "name", own, "netns", far[2])
            must("ip", "link", "set", own, "up")
            must(*far, "link", "set", own, "up")
        must("ip", "addr", "add", f"{OWN}/24", "dev", "eth1")
        for address in (ROBOT, OTHER):
            must(*far, "addr", "add", f"{address}/24", "dev", "eth1")
        made = Host(monkeypatch, tmp_path, far[2])
        yield made
        for driver in made.drivers:
            driver.close()


def shape(rate_bps: int = RATE) -> LinkShape:
    return ladder.shape(rate_bps, 0)


def sent(driver: InterfaceDriver, link: Link, traffic: TrafficClass = TrafficClass.FUSION) -> int:
    return driver.read([link])[link].classes[traffic].sent_bytes


@pytest.mark.parametrize(
    ("robots", "towards"),
    [(BEYOND, Link("R7", "down")), (HERE, Link("R1", "up"))],
    ids=["a robot beyond", "a robot on this host"],
)
def test_a_robots_packets_go_through_its_own_link_by_class(
    host: Host, robots: str, towards: Link
) -> None:
    driver = host.driver(robots)
    back = Link(towards.robot, "up" if towards.direction == "down" else "down")
    for link in (towards, back):
        driver.apply(link, shape())
        assert driver.read([link])[link].capacity_bps == RATE
    size = 200_000
    receive_in(host.beyond, ROBOT, size, TrafficClass.FUSION.tos)
    assert sent(driver, towards) >= size
    receive_in("", OWN, size, TrafficClass.FUSION.tos, frm=host.beyond)
    assert sent(driver, back) >= size
    assert driver.shaped() == {towards, back}


def test_what_is_of_no_named_robot_passes_as_before(host: Host) -> None:
    driver = host.driver()
    link = Link("R7", "down")
    driver.apply(link, shape())
    receive_in(host.beyond, OTHER, 200_000, TrafficClass.FUSION.tos)
    assert sent(driver, link) == 0
    assert "noqueue 0: dev eth1 root" in must("tc", "qdisc", "show")


def test_another_rate_keeps_the_counters(host: Host) -> None:
    driver = host.driver()
    link = Link("R7", "down")
    driver.apply(link, shape())
    receive_in(host.beyond, ROBOT, 50_000, TrafficClass.FUSION.tos)
    driver.apply(link, shape(9_000_000))
    assert driver.read([link])[link].capacity_bps == 9_000_000
    assert sent(driver, link) >= 50_000


def test_all_is_as_it_was_when_the_last_link_is_cleared(host: Host) -> None:
    before = host.kernel()
    driver = host.driver()
    links = [Link("R7", "down"), Link("R7", "up")]
    for link in links:
        driver.apply(link, shape())
    assert "clsact" in host.kernel()
    driver.clear(links[0])
    assert driver.shaped() == {links[1]}
    driver.clear(links[1])
    driver.clear(links[1])
    assert host.kernel() == before
    assert not host.state.exists()


def test_a_link_that_tc_refuses_leaves_nothing(host: Host) -> None:
    before = host.kernel()
    driver = host.driver()
    good = shape()
    bad = dict(good.classes)
    bad[TrafficClass.BACKGROUND] = ClassShape(RATE // 4, RATE, -1)
    with pytest.raises(NetworkError, match="tc refuses"):
        driver.apply(Link("R7", "up"), LinkShape(RATE, bad))
    assert host.kernel() == before


def test_an_unknown_robot_has_no_link(host: Host) -> None:
    with pytest.raises(LinkGoneError, match="COADAPT_INTERFACE_ROBOTS names R7"):
        host.driver().apply(Link("R9", "down"), shape())


@pytest.mark.parametrize(
    ("lines", "interface", "told"),
    [
        ((), "eth9", "there is no interface 'eth9' on this host; there are .*eth1"),
        ((), "lo", "'lo' is no link"),
        (
            ("ip route add default via 10.88.0.9 dev eth1",),
            "eth1",
            "eth1 carries this host's default route, .*COADAPT_INTERFACE_CONFIRMED=eth1",
        ),
        (
            ("ip route add default via 10.88.0.9 dev eth1 table 77",),
            "eth1",
            "eth1 carries this host's default route",
        ),
        (
            (
                "ip link add br0 type bridge",
                "ip link set eth0 master br0",
                "ip link set br0 up",
                "ip addr add 10.99.0.1/24 dev br0",
                "ip route add default via 10.99.0.9",
            ),
            "eth0",
            "eth0 carries this host's default route, by br0",
        ),
        (
            ("tc qdisc add dev eth1 root handle 8001: tbf rate 1mbit burst 5kb latency 50ms",),
            "eth1",
            "a qdisc of somebody else's, tbf 8001:",
        ),
        (("tc qdisc add dev eth1 clsact",), "eth1", "a qdisc of somebody else's, clsact ffff:"),
        (("tc qdisc add dev eth1 ingress",), "eth1", "a qdisc of somebody else's, ingress ffff:"),
    ],
)
def test_an_interface_that_is_not_the_swarms_is_refused_by_name(
    host: Host, lines: tuple[str, ...], interface: str, told: str
) -> None:
    for line in lines:
        must(*line.split())
    before = host.kernel()
    driver = host.driver(interface=interface)
    with pytest.raises(NetworkError, match=told):
        driver.capabilities()
    with pytest.raises(NetworkError, match=told):
        driver.apply(Link("R7", "down"), shape())
    assert host.kernel() == before
    # Whose links they are is known all the same, so that requests come here and hear why.
    assert driver.robots() == {"R7": ROBOT}


def test_the_default_routes_interface_is_shaped_where_it_is_confirmed(host: Host) -> None:
    must(*["ip", "route", "add", "default", "via", "10.88.0.9", "dev", "eth1"])
    host.patch.setenv("COADAPT_INTERFACE_CONFIRMED", "eth1")
    driver = host.driver()
    driver.apply(Link("R7", "down"), shape())
    assert driver.shaped()


def test_an_interface_that_becomes_the_default_route_is_left_alone(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("network_controller.drivers.interface.LOOK_S", 0.0)
    driver = host.driver()
    driver.apply(Link("R7", "down"), shape())
    must(*["ip", "route", "add", "default", "via", "10.88.0.9", "dev", "eth1"])
    assert driver.shaped() == frozenset()
    assert "clsact" not in host.kernel()
    must(*["ip", "route", "del", "default", "via", "10.88.0.9", "dev", "eth1"])
    driver.apply(Link("R7", "down"), shape())
    assert driver.shaped()


def test_an_interface_that_comes_back_is_shaped_anew(host: Host) -> None:
    driver = host.driver()
    link = Link("R7", "down")
    driver.apply(link, shape())
    must("ip", "link", "del", "eth1")
    assert driver.read([link]) == {}
    host.patch.setattr("network_controller.drivers.interface.LOOK_S", 0.0)
    must(
        *("ip", "link", "add", "eth1", "type", "veth", "peer", "name", "eth1"), "netns", host.beyond
    )
    must("ip", "link", "set", "eth1", "up")
    driver.clear(link)
    driver.apply(link, shape())
    assert driver.shaped() == {link}


def test_two_controllers_do_not_meet_on_one_interface(host: Host) -> None:
    first = host.driver()
    first.apply(Link("R7", "down"), shape())
    with pytest.raises(NetworkError, match="another controller shapes by"):
        host.driver().capabilities()
    assert first.shaped()


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"COADAPT_INTERFACE": ""}, "COADAPT_INTERFACE .*the name of an interface"),
        ({"COADAPT_INTERFACE_ROBOTS": ""}, "COADAPT_INTERFACE_ROBOTS"),
        ({"COADAPT_INTERFACE_ROBOTS": "R7=10.0.0.300"}, "'R7=10.0.0.300' is not valid"),
        ({"COADAPT_INTERFACE_ROBOTS": "R7=10.0.0.7,R8=10.0.0.7"}, "'R8=10.0.0.7' is there twice"),
    ],
)
def test_settings_that_say_nothing_usable_are_refused(
    host: Host, values: dict[str, str], told: str
) -> None:
    for name, value in (host.environment() | values).items():
        host.patch.setenv(name, value)
    with pytest.raises(SettingError, match=told):
        InterfaceDriver("qa")


@contextmanager
def controller(
    host: Host, *, within: Sequence[str] = (), **environment: str
) -> Iterator[subprocess.Popen[bytes]]:
    """A controller process in the host's namespace, without a router unless it is named one.
    `within`: a command that starts it in its own way."""
    process = subprocess.Popen(
        [*within, sys.executable, "-m", "network_controller"],
        env={
            **os.environ,
            **host.environment(),
            "PYTHONPATH": str(REPOSITORY),
            "COADAPT_SWARM": "qa",
            "COADAPT_DRIVER": "interface",
            "COADAPT_EGO": "R7",
            "COADAPT_METRICS_PORT": "0",
            "COADAPT_QOD_PORT": "0",
            **environment,
        },
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def ended(process: subprocess.Popen[bytes], number: int) -> None:
    process.send_signal(number)
    process.wait(30)


def gone(host: Host, before: str) -> Callable[[], bool]:
    return lambda: host.kernel() == before


def test_a_killed_controllers_traces_are_removed_by_the_next_one_and_nothing_else(
    host: Host,
) -> None:
    must(*["tc", "qdisc", "add", "dev", "eth0", "clsact"])
    before = host.kernel()
    with controller(host, COADAPT_LINK_BPS=str(RATE)) as first:
        await_(lambda: is_shaped(host), "the link is shaped")
        ended(first, signal.SIGKILL)
    assert "clsact ffff: dev eth1" in host.kernel()
    assert host.state.exists()
    with controller(host) as second:
        await_(gone(host, before), "what was left is removed")
        ended(second, signal.SIGTERM)
    assert host.kernel() == before


def test_a_controller_that_ends_leaves_the_interface_as_it_was(host: Host) -> None:
    before = host.kernel()
    with controller(host, COADAPT_LINK_BPS=str(RATE)) as process:
        await_(lambda: is_shaped(host), "the link is shaped")
        ended(process, signal.SIGTERM)
    assert host.kernel() == before
    assert not host.state.exists()


def test_what_somebody_has_put_beside_ours_stays_after_a_crash(host: Host) -> None:
    with controller(host, COADAPT_LINK_BPS=str(RATE)) as first:
        await_(lambda: is_shaped(host), "the link is shaped")
        ended(first, signal.SIGKILL)
    rule = (
        "tc filter add dev eth1 egress protocol ip pref 5 u32 match ip dst 10.88.0.8/32 flowid 1:1"
    )
    must(*rule.split())
    driver = host.driver()
    with pytest.raises(NetworkError, match="a qdisc of somebody else's, clsact"):
        driver.capabilities()
    kernel = host.kernel()
    assert "pref 5 u32" in kernel
    assert "mirred" not in kernel
    assert "cif" not in kernel


def is_shaped(host: Host) -> bool:
    """Whether all is there of the shape of R7's link downwards."""
    shown = host.kernel()
    for name in (name for name in host.interfaces() if name.startswith("cif")):
        shown += must("tc", "class", "show", "dev", name)
    return f"rate {RATE // 10**6}Mbit" in shown and "Redirect to device cif" in shown


def ask(session: Session, wish: ShapeRequest) -> ShapeReply:
    """What controller hall-2 answers."""
    key = keyspace.net_shape(session.swarm, "hall-2")
    future = session.ask(key, wish, ShapeReply, timeout_s=15.0, traffic=TrafficClass.CONTROL)
    return future.result().message


@dataclass(frozen=True)
class Hall:
    """Controller hall-2, and what it says, by a router of its own."""

    process: subprocess.Popen[bytes]
    session: Session
    states: Inbox[NetState]


@contextmanager
def hall(
    host: Host,
    swarm: str,
    open_session: SessionMaker,
    folder: Path,
    *,
    within: Sequence[str] = (),
    **environment: str,
) -> Iterator[Hall]:
    socket = f"{folder}/r"
    router = RouterProcess("--unix-socket", socket)
    states: Inbox[NetState] = Inbox()
    try:
        session = open_session(router.address)
        session.subscribe(keyspace.net_state(swarm, keyspace.ANY), NetState, states.put)
        with controller(
            host,
            within=within,
            COADAPT_SWARM=swarm,
            COADAPT_ROUTER=f"unixsock-stream/{socket}",
            COADAPT_CONTROLLER="hall-2",
            **environment,
        ) as process:
            yield Hall(process, session, states)
    finally:
        router.stop()


def test_a_link_that_cannot_be_shaped_is_told_to_all_and_later_is(
    host: Host, swarm_name: str, open_session: SessionMaker, tmp_path: Path
) -> None:
    must(*["tc", "qdisc", "add", "dev", "eth1", "clsact"])
    with hall(host, swarm_name, open_session, tmp_path) as heard:
        told = heard.states.next_where(lambda state: bool(state.unshaped))
        assert (told.name, told.robots, told.links) == ("hall-2", ("R7",), ())
        assert "clsact ffff:; it is left alone" in told.unshaped[0]
        wish = ShapeRequest(profile="rate", robot="R7", rate_bps=RATE)
        with pytest.raises(RefusedError, match="it is left alone"):
            ask(heard.session, wish)
        must(*["tc", "qdisc", "del", "dev", "eth1", "clsact"])
        heard.states.next_where(lambda state: not state.unshaped)
        assert ask(heard.session, wish).shapes[0].rate_bps == RATE
        shaped = heard.states.next_where(lambda state: bool(state.links))
        assert shaped.links[0].capacity_bps == RATE


WITHOUT_NET_ADMIN = ("setpriv", "--bounding-set", "-net_admin", "--inh-caps", "-net_admin")


def test_a_controller_without_the_right_to_shape_says_so_and_goes_on(
    host: Host, swarm_name: str, open_session: SessionMaker, tmp_path: Path
) -> None:
    before = host.kernel()
    with hall(
        *(host, swarm_name, open_session, tmp_path),
        within=WITHOUT_NET_ADMIN,
        COADAPT_LINK_BPS=str(RATE),
    ) as heard:
        told = heard.states.next_where(lambda state: bool(state.unshaped))
        assert (told.name, told.robots, told.links) == ("hall-2", ("R7",), ())
        assert "Operation not permitted; the controller needs NET_ADMIN" in told.unshaped[0]
        with pytest.raises(RefusedError, match=re.escape(told.unshaped[0])):
            ask(heard.session, ShapeRequest(profile="rate", robot="R7", rate_bps=RATE))
        assert told.unshaped[0] in ask(heard.session, ShapeRequest(profile="show")).notes
        heard.states.skip()
        assert heard.states.next().unshaped == told.unshaped
        ended(heard.process, signal.SIGTERM)
        assert heard.process.returncode == 0
    assert host.kernel() == before
