"""What the kernel tells a process of its own connections, and a router tells an ego of theirs."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, suppress
from typing import Any

import pytest

from swarm import keyspace
from swarm.messages import Observation, ObservationRequest, TcpState
from swarm.session import Session
from swarm.tcp.dead import LOOK_S, SILENT_MS, GiveUp
from swarm.tcp.info import TcpInfo, connections, tcp_info
from swarm.tcp.watch import TcpWatch
from swarm.traffic import TrafficClass
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import Inbox, RouterProcess, until, wait_until_served

Pair = tuple[socket.socket, socket.socket]


def written(address: tuple[str, int]) -> str:
    return f"{address[0]}:{address[1]}"


@pytest.fixture
def pair() -> Iterator[Pair]:
    """A connection with fusion's mark: the end that sends, and the one that receives."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.FUSION.tos)
        sender.connect(server.getsockname())
        receiver, _ = server.accept()
        with receiver:
            yield sender, receiver


@pytest.fixture
def watch() -> Iterator[TcpWatch]:
    with closing(TcpWatch()) as watch:
        yield watch


def test_a_connection_is_found_by_its_mark(pair: Pair) -> None:
    sender, _ = pair
    local = written(sender.getsockname())
    (found,) = [c for c in connections(TrafficClass.FUSION) if c.local == local]
    assert (found.descriptor, found.peer) == (sender.fileno(), written(sender.getpeername()))
    assert local not in {c.local for c in connections(TrafficClass.CONTROL)}


def test_what_was_acknowledged_and_what_waits_is_told(pair: Pair) -> None:
    sender, receiver = pair
    sender.sendall(bytes(1000))
    assert receiver.recv(1000, socket.MSG_WAITALL)
    until(lambda: told(sender).acked_bytes >= 1000, "the bytes are acknowledged")
    assert not told(sender).queued
    fill(sender)
    assert told(sender).queued


def told(of: socket.socket) -> TcpInfo:
    info = tcp_info(of.fileno())
    assert info is not None
    return info


def fill(sender: socket.socket) -> None:
    """Sends until nothing goes any more: nobody reads."""
    sender.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            sender.send(bytes(1 << 16))


def test_what_is_no_tcp_socket_tells_nothing() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        assert tcp_info(other.fileno()) is None
    assert tcp_info(10_000) is None


def test_connections_with_a_mark_fail_once_nothing_is_acknowledged_for_long(pair: Pair) -> None:
    sender, receiver = pair
    GiveUp().look()
    assert silent_ms(sender) == SILENT_MS
    assert silent_ms(receiver) == 0  # It carries no mark, so it is not the swarm's.


def test_a_new_connection_is_cared_for_at_the_next_look() -> None:
    now_s = 100.0
    give_up = GiveUp(lambda: now_s)
    give_up.look()
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.CONTROL.tos)
        sender.connect(server.getsockname())
        give_up.look()
        assert silent_ms(sender) == 0
        now_s += LOOK_S
        give_up.look()
        assert silent_ms(sender) == SILENT_MS


def test_a_client_cares_for_its_connections(shared_router: RouterProcess) -> None:
    with Session(shared_router.address, "dead"):
        until(lambda: own_limits() == {SILENT_MS}, "all of the client's are cared for", 10.0)


def own_limits() -> set[int]:
    """Of this process's Zenoh connections."""
    found = set()
    for cls in TrafficClass:
        for one in connections(cls):
            with socket.socket(fileno=os.dup(one.descriptor)) as held:
                found.add(silent_ms(held))
    return found


def silent_ms(of: socket.socket) -> int:
    return of.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)


def test_a_receiver_that_does_not_read_is_not_taken_for_a_narrow_link(
    pair: Pair, watch: TcpWatch
) -> None:
    sender, _ = pair
    fill(sender)
    until(lambda: watch.total().sent_bytes > 0, "the connection is watched", 10.0)
    before = watch.total()
    until(lambda: watch.total().seen_ms > before.seen_ms + 1500, "time goes by")
    assert watch.total().stood_ms - before.stood_ms < 300


def test_a_watched_connection_can_be_closed_and_stays_counted(pair: Pair, watch: TcpWatch) -> None:
    sender, receiver = pair
    reader = threading.Thread(target=lambda: read_all(receiver))
    reader.start()
    until(lambda: send_and_total(sender, watch) >= 200_000, "what is sent is counted")
    counted = watch.total().sent_bytes
    sender.close()
    reader.join(20.0)
    assert not reader.is_alive(), "the other end has not heard that it was closed"
    seen = watch.total().seen_ms
    until(lambda: watch.total().seen_ms > seen + 1500, "it is looked again")
    assert watch.total().sent_bytes >= counted


def read_all(receiver: socket.socket) -> None:
    while receiver.recv(1 << 16):
        pass


def send_and_total(sender: socket.socket, watch: TcpWatch) -> int:
    sender.sendall(bytes(10_000))
    return watch.total().sent_bytes


def test_a_router_tells_an_ego_what_it_has_sent_it() -> None:
    router = RouterProcess("--swarm", "told")
    seen = next(sample for sample in SAMPLES if isinstance(sample, Observation))
    large = Observation(**{**as_fields(seen), "payload": bytes(200_000)})
    try:
        with (
            Session(router.address, "told", timeout_s=10.0) as robot,
            Session(router.address, "told", timeout_s=10.0) as ego,
        ):
            states: Inbox[TcpState] = Inbox()
            ego.subscribe(keyspace.net_tcp("told"), TcpState, states.put)
            key = keyspace.observation("told", "R1")
            robot.serve(key, ObservationRequest, lambda _: large)
            wait_until_served(ego, key)
            until(lambda: ego.links() == 3, "each class has its link")
            request = ObservationRequest(ego="E", request=9, algorithm="early", capture_ns=0)
            own = {c.local for c in connections(TrafficClass.FUSION)}

            def told_of_large_answers() -> bool:
                ego.ask(key, request, Observation, timeout_s=10.0).result(20.0)
                return sent_to(own, states) >= 200_000

            until(told_of_large_answers, "the router tells of what it sends")
    finally:
        router.stop()


def sent_to(own: set[str], states: Inbox[TcpState]) -> int:
    """Bytes that went to any of these addresses, by the states that have come."""
    sent = [0]
    while not states.empty():
        sent += [b.sent_bytes for peer, b in states.next().peers.items() if peer in own]
    return max(sent)


def as_fields(message: Observation) -> dict[str, Any]:
    return {name: getattr(message, name) for name in message.__struct_fields__}
