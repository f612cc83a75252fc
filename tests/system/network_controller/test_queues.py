"""The queues of real links: who samples them sees the rate that the kernel shapes."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing

import pytest

from network_controller import ladder
from network_controller.drivers.netlink import ClassReader
from network_controller.model import DIRECTIONS, Link, Queue
from network_controller.queues import QueueWatch
from swarm.log import make_logger
from swarm.messages import Backlog, Direction
from swarm.tcp.watch import TcpWatch
from swarm.traffic import TrafficClass
from tests.support.link_support import Links, fill, links
from tests.support.zenoh_fixtures import until

RATE_BPS = 2_000_000
PORT = 5599
_RECEIVE = f"""
import socket, sys
server = socket.create_server((sys.argv[1], {PORT}))
print("up", flush=True)
peer, _ = server.accept()
while peer.recv(65536):
    pass
"""
_SEND = f"""
import socket
with socket.create_connection(("10.77.0.1", {PORT})) as out:
    for _ in range(20):
        out.sendall(bytes(20_000))
"""


@pytest.fixture
def net() -> Iterator[Links]:
    with links() as net:
        yield net


@pytest.fixture
def queues() -> Iterator[QueueWatch]:
    with closing(QueueWatch(make_logger("test", level="critical"))) as queues:
        yield queues


STREAMS, SAMPLED_MS = 4, 300
"""Sent until queues were seen to stand for so long, at most so many: a busy machine delays the
threads that sample them."""


def rate_bps(backlog: Backlog) -> float:
    assert backlog.stood_ms > SAMPLED_MS
    return 8e3 * backlog.stood_bytes / backlog.stood_ms


def stream(net: Links, size: int) -> None:
    """Sends from the bridge's host to the first robot by TCP, in this process."""
    robot = net.robots[0]
    address = net.driver.robots()[robot]
    with subprocess.Popen(
        ["nsenter", f"--net=/run/netns/{robot}", sys.executable, "-c", _RECEIVE, address],
        stdout=subprocess.PIPE,
        text=True,
    ) as receiver:
        assert receiver.stdout is not None
        assert receiver.stdout.readline() == "up\n"
        with socket.socket() as sender:
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.FUSION.tos)
            sender.connect((address, PORT))
            sender.sendall(bytes(size))
            sender.shutdown(socket.SHUT_WR)
            until(lambda: receiver.poll() is not None, "all has arrived")


def test_the_shaper_and_tcp_both_see_the_rate_of_a_link_that_is_filled(
    net: Links, queues: QueueWatch
) -> None:
    link = Link(net.robots[0], "down")
    net.driver.apply(link, ladder.shape(RATE_BPS, 0))
    queues.start()
    queues.watch({link: net.driver.read([link])[link].queue})
    with closing(TcpWatch()) as watch:
        for _ in range(STREAMS):
            stream(net, 1_000_000)
            sent, shaped = watch.total(), queues.read(link)[TrafficClass.FUSION]
            if min(sent.stood_ms, shaped.stood_ms) > SAMPLED_MS:
                break
    assert rate_bps(shaped) == pytest.approx(RATE_BPS, rel=0.25)
    assert rate_bps(sent) == pytest.approx(RATE_BPS, rel=0.25)
    assert queues.read(link)[TrafficClass.CONTROL].stood_ms == 0


def test_on_a_link_that_is_wide_enough_no_queue_stands(net: Links, queues: QueueWatch) -> None:
    link = Link(net.robots[0], "down")
    net.driver.apply(link, ladder.shape(1_000_000_000, 0))
    queues.start()
    queues.watch({link: net.driver.read([link])[link].queue})
    # On a busy machine the stream could be over before the first sample.
    until(lambda: TrafficClass.FUSION in queues.read(link), "sampling has begun")
    with closing(TcpWatch()) as watch:
        stream(net, 1_000_000)
        until(
            lambda: bool(
                queues.read(link)[TrafficClass.FUSION].sent_bytes or watch.total().seen_ms
            ),
            "it was sampled",
        )
        assert watch.total().stood_ms < 100
    assert queues.read(link)[TrafficClass.FUSION].stood_ms < 100


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_what_waits_is_read_as_tc_shows_it(net: Links, direction: Direction) -> None:
    link = Link(net.robots[0], direction)
    net.driver.apply(link, ladder.shape(10_000, 0))
    queue_of = net.driver.read([link])[link].queue
    with closing(ClassReader()) as reader:
        assert set(reader.read(queue_of)) == set(TrafficClass)
        if direction == "down":
            fill("10.77.1.1", 40_000, TrafficClass.FUSION.tos)
        shown = net.driver.read([link])[link].classes
        for traffic, queue in reader.read(queue_of).items():
            assert queue.waiting_bytes == pytest.approx(shown[traffic].backlog_bytes, abs=2048)
            assert queue.sent_bytes == pytest.approx(shown[traffic].sent_bytes, abs=2048)
        assert reader.read(Queue("nowhere")) == {}
        assert reader.read(Queue("lo")) == {}


def test_what_goes_up_does_not_wait_for_acknowledgements_behind_a_queue_that_goes_down(
    net: Links,
) -> None:
    down = Link(net.robots[0], "down")
    net.driver.apply(down, ladder.shape(64_000, 0))
    for traffic in (TrafficClass.CONTROL, TrafficClass.FUSION):
        fill("10.77.1.1", 60_000, traffic.tos)
    with socket.create_server(("10.77.0.1", PORT)) as server:
        sender = subprocess.Popen(
            ["nsenter", f"--net=/run/netns/{net.robots[0]}", sys.executable, "-c", _SEND]
        )
        with sender:
            server.settimeout(30.0)
            peer, _ = server.accept()
            with peer:
                # Its acknowledgements are marked as what it sends is.
                peer.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.FUSION.tos)
                while peer.recv(65536):
                    pass
    left = net.driver.read([down])[down].classes
    assert left[TrafficClass.FUSION].backlog_bytes > 30_000, "all was here before half of that"


def test_a_link_that_was_made_anew_is_counted_anew(net: Links, queues: QueueWatch) -> None:
    link = Link(net.robots[0], "down")
    net.driver.apply(link, ladder.shape(10_000, 0))
    queues.start()
    queues.watch({link: net.driver.read([link])[link].queue})
    fill("10.77.1.1", 40_000, TrafficClass.FUSION.tos)
    until(lambda: stood_ms(queues, link) > 200, "the queue stands")
    before = queues.read(link)[TrafficClass.FUSION].stood_ms
    net.driver.clear(link)
    net.driver.apply(link, ladder.shape(10_000, 0))
    fill("10.77.1.1", 40_000, TrafficClass.FUSION.tos)
    until(lambda: stood_ms(queues, link) > before + 200, "the new one is counted, too")
    queues.watch({})
    assert queues.read(link) == {}


def stood_ms(queues: QueueWatch, link: Link) -> int:
    return queues.read(link).get(TrafficClass.FUSION, Backlog()).stood_ms
