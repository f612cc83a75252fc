"""Traffic classes travel on TCP connections of their own, marked in both directions."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass

import pytest

from swarm import keyspace
from swarm.messages import Observation, ObservationRequest
from swarm.session import Session
from swarm.traffic import LINKS, TrafficClass
from tests.support.zenoh_fixtures import (
    WAIT_S,
    RouterProcess,
    SessionMaker,
    until,
    wait_until_served,
)

SIZE = 300_000


@dataclass(frozen=True)
class Socket:
    """One end of an established TCP connection, as the kernel tells it."""

    local: int
    remote: int
    tos: int
    sent: int


def sockets(router: RouterProcess) -> list[Socket]:
    """Both ends of all connections to the router."""
    if shutil.which("ss") is None:
        pytest.skip("no ss: install iproute2")
    listing = subprocess.run(
        ["ss", "-tniOH", "--tos", "state", "established"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    found = []
    ports = range(router.port, router.port + LINKS)
    for line in listing.splitlines():
        local, remote = (int(a.rsplit(":", 1)[1]) for a in line.split()[2:4])
        if local in ports or remote in ports:
            tos = re.search(r"tos:0x([0-9a-f]+)", line)
            sent = re.search(r"bytes_sent:(\d+)", line)
            assert tos is not None, line
            found.append(Socket(local, remote, int(tos[1], 16), int(sent[1]) if sent else 0))
    return found


def sent_by(router: RouterProcess, port: int, *, client: bool) -> int:
    """Bytes that all clients (or the router) sent over the connections of one class."""
    return sum(s.sent for s in sockets(router) if (s.remote if client else s.local) == port)


@pytest.fixture
def asker_and_server(
    own_router: RouterProcess, open_session: SessionMaker
) -> tuple[Session, Session]:
    return open_session(own_router.address), open_session(own_router.address)


def big(request: ObservationRequest) -> Observation:
    return Observation(
        robot="R1",
        instance=1,
        request=request.request,
        algorithm="early",
        capture_ns=1,
        frame=1,
        pose=(0.0,) * 6,
        payload=bytes(SIZE),
        encode_ms=0.0,
    )


@pytest.mark.usefixtures("asker_and_server")
def test_both_ends_mark_the_packets_of_every_class(own_router: RouterProcess) -> None:
    for cls in TrafficClass:
        port = own_router.port + cls.value.port_offset
        ends = [s for s in sockets(own_router) if port in (s.local, s.remote)]
        assert len(ends) == 4, f"{cls.name}: two sessions, two ends each"
        assert {s.tos for s in ends} == {cls.tos}


@pytest.mark.parametrize("cls", TrafficClass, ids=lambda cls: cls.name.lower())
def test_what_is_asked_in_a_class_travels_on_its_connection_there_and_back(
    cls: TrafficClass, own_router: RouterProcess, asker_and_server: tuple[Session, Session]
) -> None:
    asker, server = asker_and_server
    key = keyspace.observation(server.swarm, "R1")
    server.serve(key, ObservationRequest, big)
    wait_until_served(asker, key)
    request = ObservationRequest(ego="E", request=1, algorithm="early", capture_ns=0)
    ports = {other: own_router.port + other.value.port_offset for other in TrafficClass}
    before = {
        (other, client): sent_by(own_router, ports[other], client=client)
        for other in TrafficClass
        for client in (True, False)
    }
    asker.ask(key, request, Observation, timeout_s=10, traffic=cls).result(WAIT_S)
    # The server's answer goes up to the router, and the router's down to the asker.
    for client in (True, False):
        until(
            lambda client=client: (  # type: ignore[misc]
                sent_by(own_router, ports[cls], client=client) - before[cls, client] >= SIZE
            ),
            f"{SIZE} bytes of {cls.name}",
        )
        for other in set(TrafficClass) - {cls}:
            others = sent_by(own_router, ports[other], client=client) - before[other, client]
            assert others < SIZE / 10
