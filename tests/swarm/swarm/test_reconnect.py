"""Sessions outlive their router and single links: all links, tokens and queryables come back."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from swarm import keyspace
from swarm.errors import TransportError
from swarm.messages import Beacon, Observation, ObservationRequest
from swarm.session import Session
from swarm.traffic import LINKS
from tests.support.free_ports import free_ports
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import (
    WAIT_S,
    Inbox,
    RouterProcess,
    SessionMaker,
    until,
    wait_until_served,
)

BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))
REQUEST = ObservationRequest(ego="E1", request=5, algorithm="early", capture_ns=0)


def observation(request: ObservationRequest) -> Observation:
    return Observation(
        robot="R1",
        instance=1,
        request=request.request,
        algorithm=request.algorithm,
        capture_ns=1,
        frame=1,
        pose=(0.0,) * 6,
        payload=b"scan",
        encode_ms=1.0,
    )


class Proxy:
    """Stands between a client and the router, so that a test can cut one class's link."""

    def __init__(self, router: RouterProcess) -> None:
        self.port = free_ports(LINKS)
        self._links: list[tuple[int, socket.socket, socket.socket]] = []
        self._listeners = []
        for offset in range(LINKS):
            listener = socket.create_server(("127.0.0.1", self.port + offset))
            self._listeners.append(listener)
            threading.Thread(
                target=self._accept, args=(listener, offset, router.port + offset), daemon=True
            ).start()

    def _accept(self, listener: socket.socket, offset: int, target: int) -> None:
        while True:
            try:
                near, _ = listener.accept()
                far = socket.create_connection(("127.0.0.1", target))
            except OSError:
                return
            self._links.append((offset, near, far))
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=(source, sink), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)

    def cut(self, offset: int) -> None:
        """Breaks every connection of one class; new ones are let through."""
        for _, near, far in [link for link in self._links if link[0] == offset]:
            for end in (near, far):
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        for listener in self._listeners:
            listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        for _, near, far in self._links:
            near.close()
            far.close()


@pytest.fixture
def proxy(own_router: RouterProcess) -> Iterator[Proxy]:
    between = Proxy(own_router)
    yield between
    between.close()


def test_after_a_router_restart_everything_is_back(
    own_router: RouterProcess, open_session: SessionMaker
) -> None:
    robot, ego = open_session(own_router.address), open_session(own_router.address)
    events: Inbox[tuple[str, str]] = Inbox()
    beacons: Inbox[Beacon] = Inbox()
    key = keyspace.observation(robot.swarm, "R1")
    ego.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    ego.subscribe(keyspace.beacon(ego.swarm, keyspace.ANY), Beacon, beacons.put)
    robot.serve(key, ObservationRequest, observation)
    robot.declare_alive("R1")
    assert events.next() == ("join", "R1")

    own_router.stop(kill=True)
    assert events.next() == ("leave", "R1")
    until(lambda: robot.links() == 0 and ego.links() == 0, "the links are gone")
    begun = time.monotonic()
    robot.put(keyspace.beacon(robot.swarm, "R1"), BEACON)
    with pytest.raises(TransportError):
        ego.ask(key, REQUEST, Observation, timeout_s=1.0).result(WAIT_S)
    assert time.monotonic() - begun < WAIT_S

    own_router.start()
    assert events.next() == ("join", "R1")
    until(lambda: robot.links() == LINKS and ego.links() == LINKS, "all links are back")
    until(lambda: ego.alive() == ("R1",), "the token is back")
    wait_until_served(ego, key)
    answer = ego.ask(key, REQUEST, Observation, timeout_s=5.0).result(WAIT_S)
    assert answer.message.payload == b"scan"
    robot.put(keyspace.beacon(robot.swarm, "R1"), BEACON)
    assert beacons.next() == BEACON
    # Replacing the sessions was no join and no leave of anybody.
    assert events.empty()


@pytest.mark.parametrize("offset", range(LINKS))
def test_a_single_broken_link_comes_back_and_the_robot_never_leaves(
    offset: int, own_router: RouterProcess, proxy: Proxy, open_session: SessionMaker
) -> None:
    robot = open_session(f"tcp/127.0.0.1:{proxy.port}")
    ego = open_session(own_router.address)
    events: Inbox[tuple[str, str]] = Inbox()
    ego.watch_alive(lambda r: events.put(("join", r)), lambda r: events.put(("leave", r)))
    key = keyspace.observation(robot.swarm, "R1")
    robot.serve(key, ObservationRequest, observation)
    robot.declare_alive("R1")
    assert events.next() == ("join", "R1")
    assert robot.links() == LINKS

    proxy.cut(offset)
    until(lambda: robot.links() < LINKS, "the link is broken")
    # The other links carry on meanwhile.
    wait_until_served(ego, key)
    assert _answered(ego, key)
    until(lambda: robot.links() == LINKS, "the link is back")
    wait_until_served(ego, key)
    assert _answered(ego, key)
    assert events.empty()


def _answered(ego: Session, key: str) -> bool:
    return ego.ask(key, REQUEST, Observation, timeout_s=5.0).result(WAIT_S).wire_bytes > 0


def test_publishing_while_the_router_is_away_never_waits(
    own_router: RouterProcess, open_session: SessionMaker
) -> None:
    session = open_session(own_router.address)
    own_router.stop(kill=True)
    until(lambda: session.links() == 0, "the links are gone")
    done = threading.Event()

    def publish() -> None:
        for _ in range(1000):
            session.put(keyspace.beacon(session.swarm, "R1"), BEACON)
        done.set()

    threading.Thread(target=publish, daemon=True).start()
    assert done.wait(WAIT_S)


def test_a_session_closes_while_its_router_is_away(
    own_router: RouterProcess, open_session: SessionMaker
) -> None:
    session = open_session(own_router.address)
    session.declare_alive("R1")
    session.serve(keyspace.observation(session.swarm, "R1"), ObservationRequest, observation)
    own_router.stop(kill=True)
    until(lambda: session.links() == 0, "the links are gone")
    closer = threading.Thread(target=session.close)
    closer.start()
    closer.join(WAIT_S)
    assert not closer.is_alive()


def test_requests_under_way_end_when_their_session_closes(
    own_router: RouterProcess, open_session: SessionMaker
) -> None:
    server, asker = open_session(own_router.address), open_session(own_router.address)
    go = threading.Event()
    begun: Inbox[int] = Inbox()

    def slow(request: ObservationRequest) -> Observation:
        begun.put(request.request)
        go.wait(WAIT_S)
        return observation(request)

    key = keyspace.observation(server.swarm, "R1")
    server.serve(key, ObservationRequest, slow)
    wait_until_served(asker, key)
    future = asker.ask(key, REQUEST, Observation, timeout_s=WAIT_S)
    begun.next()
    asker.close()
    go.set()
    with pytest.raises(TransportError):
        future.result(WAIT_S)
