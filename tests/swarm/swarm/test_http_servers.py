"""What holds at every HTTP endpoint: nobody takes the last place from another."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import NamedTuple

import pytest
from prometheus_client import CollectorRegistry, Counter

from llm_gateway.http_endpoint import MAX_CONNECTIONS as GATEWAY_PLACES
from llm_gateway.model import Completion, Hear, Job
from network_controller.qod.server import MAX_CONNECTIONS as QOD_PLACES
from options.console.endpoint import MAX_CONNECTIONS as CONSOLE_PLACES
from swarm.http import metrics_server
from swarm.metrics import MetricsServer
from tests.support import qod_client
from tests.support.console_swarm import console
from tests.support.llm_endpoint import endpoint_of
from tests.support.zenoh_fixtures import RouterProcess, until

HERE, STRANGER, SECOND = "127.0.0.1", "127.0.0.2", "127.0.0.3"
"""All of the loopback is this host's own."""


class Endpoint(NamedTuple):
    port: int
    places: int
    path: str


class Silent:
    """A gateway that nobody gets an answer from."""

    model = "none"

    async def complete(self, job: Job, hear: Hear | None = None) -> Completion:
        raise AssertionError("nobody asks")


@contextmanager
def metrics() -> Generator[Endpoint]:
    registry = CollectorRegistry()
    Counter("coadapt_example", "An example.", registry=registry).inc()
    server = MetricsServer(registry, 0, HERE)
    try:
        yield Endpoint(server.port, metrics_server.PLACES, "/metrics")
    finally:
        server.close()


@pytest.fixture(params=["metrics", "qod", "gateway", "console"])
def endpoint(
    request: pytest.FixtureRequest, shared_router: RouterProcess, swarm_name: str
) -> Iterator[Endpoint]:
    with ExitStack() as open_now:
        match request.param:
            case "metrics":
                yield open_now.enter_context(metrics())
            case "qod":
                api = open_now.enter_context(qod_client.served())
                yield Endpoint(api.server.port, QOD_PLACES, qod_client.PROFILES)
            case "gateway":
                client = open_now.enter_context(endpoint_of(Silent()))
                yield Endpoint(client.port, GATEWAY_PLACES, "/v1/models")
            case _:
                port = open_now.enter_context(console(shared_router.address, swarm_name))
                yield Endpoint(port, CONSOLE_PLACES, "/api/floor")


def status(endpoint: Endpoint, host: str = "localhost") -> int:
    """Of a request from this host; 0 where the connection is closed without an answer."""
    with closing(http.client.HTTPConnection(HERE, endpoint.port, timeout=20)) as to:
        try:
            to.request("GET", endpoint.path, headers={"Host": host})
            return to.getresponse().status
        except (ConnectionError, http.client.RemoteDisconnected):
            return 0


def left_alone(connection: socket.socket) -> bool:
    """Whether the server has neither said something nor closed."""
    connection.setblocking(False)
    try:
        connection.recv(1024)
    except BlockingIOError:
        return True
    except ConnectionError:
        pass
    return False


@contextmanager
def flood(endpoint: Endpoint, *origins: str, says: bytes = b"") -> Generator[list[socket.socket]]:
    """As many connections as there are places, from each address; they say little, and stay."""
    with ExitStack() as held:
        connections = []
        for address in origins:
            for _ in range(endpoint.places):
                made = socket.create_connection(
                    (HERE, endpoint.port), 20, source_address=(address, 0)
                )
                connections.append(held.enter_context(made))
                if says:
                    try:
                        made.sendall(says)
                    except ConnectionError:
                        continue
        yield connections


def settled(connections: list[socket.socket], most: int) -> Callable[[], bool]:
    return lambda: sum(map(left_alone, connections)) <= most


@pytest.mark.parametrize("says", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "])
def test_one_address_never_takes_the_last_place(endpoint: Endpoint, says: bytes) -> None:
    with flood(endpoint, STRANGER, says=says) as connections:
        until(settled(connections, endpoint.places // 2), "half of the places are free")
        assert status(endpoint) == 200


def test_two_addresses_do_not_take_the_last_place(endpoint: Endpoint) -> None:
    with flood(endpoint, STRANGER, SECOND) as connections:
        until(settled(connections, 3 * endpoint.places // 4), "a quarter of the places is free")
        assert status(endpoint) == 200


def test_who_has_his_share_gets_it_again_once_he_has_left(endpoint: Endpoint) -> None:
    with flood(endpoint, HERE) as connections:
        until(settled(connections, endpoint.places // 2), "half of the places are free")
    until(lambda: status(endpoint) == 200, "he is answered again")


@pytest.mark.parametrize("host", ["evil.example", "10.0.0.1", ""])
def test_a_name_that_somebody_had_lead_here_is_refused(endpoint: Endpoint, host: str) -> None:
    assert status(endpoint, host) in (403, 421)
    for own in ("localhost", "LOCALHOST:80", "127.0.0.1", f"127.0.0.1:{endpoint.port}", "[::1]"):
        assert status(endpoint, own) == 200


def test_who_asks_for_metrics_byte_by_byte_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics_server, "CONNECTION_S", 0.5)
    with metrics() as endpoint, socket.create_connection((HERE, endpoint.port), 20) as slow:
        slow.sendall(b"GET /metrics HTTP/1.1\r\nX: ")
        slow.settimeout(0.05)

        def gone() -> bool:
            try:
                slow.sendall(b"x")
                return slow.recv(1024) == b""
            except TimeoutError:
                return False
            except ConnectionError:
                return True

        until(gone, "the server lets go")
    with metrics() as endpoint:
        assert status(endpoint) == 200


def test_metrics_have_a_bounded_number_of_threads() -> None:
    with (
        metrics() as endpoint,
        flood(endpoint, *(f"127.0.0.{n}" for n in range(2, 8))) as connections,
    ):
        until(settled(connections, endpoint.places - 1), "most are closed")
        names = [thread.name for thread in threading.enumerate()]
        assert sum("process_request_thread" in name for name in names) < endpoint.places


def test_off_the_loopback_metrics_are_told_under_any_name() -> None:
    """Prometheus asks containers by their names."""
    server = MetricsServer(CollectorRegistry(), 0, "0.0.0.0")
    try:
        assert status(Endpoint(server.port, 0, "/metrics"), "R3:9101") == 200
    finally:
        server.close()
