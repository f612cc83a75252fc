"""Nobody reaches through the controller what only the controller reaches."""

from __future__ import annotations

import http.client
import socket
from collections.abc import Generator
from contextlib import closing
from ipaddress import ip_address

import pytest

from network_controller.qod import destinations, events
from network_controller.qod.destinations import Destinations, is_public, meant
from network_controller.qod.problems import Problem
from swarm.errors import SettingError
from tests.support.qod_client import LOOPBACK, SESSIONS, Api, Sink, listening, served
from tests.support.zenoh_fixtures import until

EVENTS = "coadapt_qod_events_total"

INNER = [
    "127.0.0.1",
    "127.8.7.6",
    "127.1",
    "2130706433",
    "0x7f000001",
    "localhost",
    "[::1]",
    "[::]",
    "0.0.0.0",
    "[::ffff:127.0.0.1]",
    "[::ffff:7f00:1]",
    "[::127.0.0.1]",
    "[::ffff:0:127.0.0.1]",
    "[64:ff9b::127.0.0.1]",
    "[64:ff9b::10.0.0.1]",
    "[2002:7f00:1::]",
    "[2002:a00:1::5]",
    "10.0.0.1",
    "172.16.0.1",
    "192.168.1.1",
    "169.254.169.254",
    "100.64.0.1",
    "198.18.0.1",
    "224.0.0.251",
    "240.0.0.1",
    "255.255.255.255",
    "[fe80::1]",
    "[fd00::1]",
    "[fec0::1]",
    "[ff02::1]",
    "[2001:db8::1]",
    "[2001:0:7f00:1::]",
]


@pytest.fixture(scope="module")
def api() -> Generator[Api]:
    with served() as api:
        yield api


@pytest.fixture
def sink() -> Generator[Sink]:
    with listening() as sink:
        yield sink


@pytest.mark.parametrize("scheme", ["http", "https"])
@pytest.mark.parametrize("host", INNER)
def test_a_sink_that_is_not_public_is_refused(api: Api, host: str, scheme: str) -> None:
    reply = api.create(sink=f"{scheme}://{host}:9090/events")
    assert (reply.status, reply.body["code"]) == (400, "INVALID_SINK")
    assert "COADAPT_QOD_SINKS" in reply.body["message"], reply.body
    assert not api.links.holds


def test_a_service_on_the_loopback_hears_nothing(api: Api, sink: Sink) -> None:
    assert api.create(sink=sink.url).status == 400
    assert api.create(sink=sink.url.replace("127.0.0.1", "localhost")).status == 400
    assert sink.received.empty()


@pytest.mark.parametrize("host", ["nobody.invalid", "a" * 64 + ".com", "a..b"])
def test_a_name_that_leads_nowhere_is_refused(api: Api, host: str) -> None:
    reply = api.create(sink=f"https://{host}/events")
    assert (reply.status, reply.body["code"]) == (400, "INVALID_SINK")
    assert "cannot be resolved" in reply.body["message"]


@pytest.mark.parametrize(
    "address", ["1.1.1.1", "93.184.216.34", "2606:4700::1111", "64:ff9b::1.1.1.1", "2002:101:101::"]
)
def test_public_addresses_are_allowed(address: str) -> None:
    assert is_public(ip_address(address))
    assert Destinations().checked(address) == [ip_address(address)]


@pytest.mark.parametrize(
    ("listed", "host"),
    [
        ("10.1.0.0/16", "10.1.2.3"),
        ("10.1.2.3", "10.1.2.3"),
        ("127.0.0.0/8", "127.1"),
        ("localhost", "localhost"),
        ("LocalHost.", "localhost"),
        ("127.0.0.0/8", "::ffff:127.0.0.1"),
        ("fd00:7::/48", "fd00:7::1"),
    ],
)
def test_what_the_operator_lists_is_allowed(listed: str, host: str) -> None:
    with pytest.raises(Problem):
        Destinations(["192.0.2.0/24"]).checked(host)
    assert Destinations(["192.0.2.0/24", listed]).checked(host)


def test_a_list_lets_in_no_more_than_it_says() -> None:
    listed = Destinations(["10.1.0.0/16", "hooks.plant"])
    for host in ("10.2.0.1", "127.0.0.1", "169.254.169.254", "localhost"):
        with pytest.raises(Problem, match="operator's list"):
            listed.checked(host)


@pytest.mark.parametrize("entry", ["", "10.1.0.1/16", "10.0.0", "10.0.0.0/33", "a b", "http://a/"])
def test_a_list_with_something_else_is_refused(entry: str) -> None:
    with pytest.raises(SettingError, match="COADAPT_QOD_SINKS"):
        Destinations([entry])


def test_of_several_addresses_each_must_be_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(destinations, "resolve", lambda host: ["1.1.1.1", "10.0.0.1"])
    with pytest.raises(Problem, match=r"leads to 10\.0\.0\.1, which is private"):
        Destinations().checked("two.example")


def test_a_name_that_leads_elsewhere_later_is_not_followed(
    sink: Sink, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As an attacker's own name server answers: public when it is checked, loopback afterwards."""
    monkeypatch.setattr(events, "PAUSE_S", 0.01)
    answers = [["1.1.1.1"], ["127.0.0.1"]]

    def resolve(host: str) -> list[str]:
        return answers.pop(0) if len(answers) > 1 else answers[0]

    with served() as api:
        monkeypatch.setattr(destinations, "resolve", resolve)
        url = f"https://rebound.example:{sink.server.server_port}/"
        assert api.create(sink=url).status == 201
        until(lambda: api.count(EVENTS, outcome="forbidden") == 1, "an event that is forbidden")
        assert sink.received.empty()


def test_an_event_goes_to_the_address_that_was_checked(
    sink: Sink, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the system would make of the name: nothing looks it up a second time."""
    monkeypatch.setattr(destinations, "resolve", lambda host: ["127.0.0.1"])
    with served(sinks=LOOPBACK) as api:
        port = sink.server.server_port
        assert api.create(sink=f"http://nobody.invalid:{port}/x").status == 201
        assert sink.next().headers["host"] == f"nobody.invalid:{port}"


def test_names_that_are_looked_up_keep_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(destinations, "RESOLVE_S", 0.2)
    silent, done = socket.socketpair()

    def resolve(host: str) -> list[str]:
        done.recv(1)
        return ["1.1.1.1"]

    with closing(silent), closing(done), served() as api:
        monkeypatch.setattr(destinations, "resolve", resolve)
        for _ in range(destinations.RESOLVING):
            reply = api.create(sink="https://slow.example/")
            assert "no answer within" in reply.body["message"]
        assert "too many" in api.create(sink="https://slow.example/").body["message"]
        assert api.create().status == 201
        silent.close()
        until(
            lambda: api.create(sink="https://slow.example/").body.get("code") != "INVALID_SINK",
            "that names are looked up again",
        )


def test_a_redirect_to_the_inside_is_not_followed(sink: Sink) -> None:
    with listening() as inner, served(sinks=LOOPBACK) as api:
        sink.statuses, sink.location = [307], inner.url
        session = api.create(sink=sink.url).body
        sink.next()
        until(lambda: api.count(EVENTS, outcome="refused") == 1, "an event that is refused")
        api.send("DELETE", f"{SESSIONS}/{session['sessionId']}")
        sink.next()
        assert inner.received.empty()


def test_what_is_mapped_is_what_it_means() -> None:
    assert meant("::ffff:10.0.0.1") == ip_address("10.0.0.1")
    assert meant("fd00::1") == ip_address("fd00::1")


def test_no_proxy_of_the_environment_is_asked(sink: Sink, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:1")
    with served(sinks=LOOPBACK) as api:
        assert api.create(sink=sink.url).status == http.client.CREATED
        sink.next()
