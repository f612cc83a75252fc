"""Telemetry between real sockets: what arrives, how it is marked, and that it ends."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from network_controller.telemetry.sink import Sink
from network_controller.telemetry.source import DATAGRAM, MAX_CHUNK, TCP_SHARE, UDP_HEADERS, Source
from swarm.traffic import TrafficClass
from tests.support.zenoh_fixtures import until

HOST = "127.0.0.1"
WAIT_S = 30.0
SOURCE = (sys.executable, "-m", "network_controller.telemetry.source", "--to", HOST)
SINK = (sys.executable, "-m", "network_controller.telemetry.sink", "--host", HOST)


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit status, output and errors of a process that ends by itself."""
    try:
        out, err = process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
    return process.returncode, out, err


def start(*argv: str) -> subprocess.Popen[str]:
    return subprocess.Popen(argv, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def source(port: int, rate_bps: float, seconds: float, *options: str) -> subprocess.Popen[str]:
    numbers = ("--port", str(port), "--rate-bps", str(rate_bps), "--seconds", str(seconds))
    return start(*SOURCE, *numbers, *options)


def free_port() -> int:
    """A port that is free for both protocols."""
    with Sink(HOST, 0) as sink:
        return sink.port


@contextmanager
def in_background(*actions: Callable[[], None]) -> Iterator[None]:
    threads = [threading.Thread(target=action) for action in actions]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for thread in threads:
            thread.join(WAIT_S)
    assert not any(thread.is_alive() for thread in threads)


@contextmanager
def sending(
    sender: Source, over: threading.Event, *, udp_bps: float, tcp_bps: float
) -> Iterator[None]:
    """Both flows, until the block ends."""
    with in_background(lambda: sender.datagrams(udp_bps), lambda: sender.stream(tcp_bps)):
        try:
            yield
        finally:
            over.set()


def take_both(sink: Sink) -> None:
    def taken() -> bool:
        sink.run(0.2)
        return min(sink.received.values()) > 0

    until(taken, "both protocols have come", WAIT_S)


def test_the_sink_counts_every_byte_of_both_protocols_and_ends_when_nothing_comes() -> None:
    sink = start(*SINK, "--port", "0", "--seconds", "60", "--idle", "4")
    assert sink.stdout is not None
    port = json.loads(sink.stdout.readline())["ready"]
    status, out, err = ended(source(port, 2e6, 0.8))
    assert (status, err) == (0, "")
    sent = json.loads(out)
    assert min(sent.values()) > 0
    status, out, err = ended(sink)
    assert (status, err) == (0, "")
    assert json.loads(out) == sent


def test_a_source_waits_for_a_sink_that_is_not_there_yet() -> None:
    over = threading.Event()
    sender = Source(HOST, free_port(), WAIT_S, lambda: not over.is_set())
    with sending(sender, over, udp_bps=1e6, tcp_bps=1e6):
        until(lambda: sender.sent["udp"] > 0, "datagrams go out")
        with Sink(*sender.to) as sink:
            take_both(sink)


def test_without_a_sink_datagrams_fill_the_link_all_the_same() -> None:
    status, out, err = ended(source(free_port(), 1e6, 0.5))
    assert (status, err) == (0, "")
    sent = json.loads(out)
    assert sent["udp"] > 0
    assert sent["tcp"] == 0


def test_a_source_never_sends_more_than_its_rate_with_headers() -> None:
    rate_bps, seconds = 20e6, 0.5
    with Sink(HOST, 0) as sink, in_background(lambda: sink.run(2 * seconds)):
        sender = Source(HOST, sink.port, seconds)
        sender.datagrams(rate_bps)
        frames = sender.sent["udp"] / DATAGRAM
        assert 0 < (frames - 1) * (DATAGRAM + UDP_HEADERS) * 8 <= rate_bps * seconds
        sender = Source(HOST, sink.port, seconds)
        sender.stream(rate_bps)
    wire_bits = (sender.sent["tcp"] - MAX_CHUNK) / TCP_SHARE * 8
    assert sender.sent["tcp"] > 0
    assert wire_bits <= rate_bps * seconds


def test_datagrams_are_marked_as_background() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.setsockopt(socket.IPPROTO_IP, socket.IP_RECVTOS, 1)
        receiver.settimeout(WAIT_S)
        receiver.bind((HOST, 0))
        Source(HOST, receiver.getsockname()[1], 0.1).datagrams(1e6)
        _, ancillary, _, _ = receiver.recvmsg(2048, 64)
    assert [data[0] for _, kind, data in ancillary if kind == socket.IP_TOS] == [
        TrafficClass.BACKGROUND.tos
    ]


def test_every_packet_of_the_stream_is_marked_as_background() -> None:
    if os.getuid() != 0:
        pytest.skip("only root can look at packets")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_TCP) as packets,
        Sink(HOST, 0) as sink,
    ):
        packets.settimeout(WAIT_S)
        with in_background(lambda: sink.run(0.5)):
            Source(HOST, sink.port, 0.2).stream(1e6)
        marks: list[int] = []
        while len(marks) < 3:
            packet = packets.recv(65_536)
            header = 4 * (packet[0] & 0x0F)
            if int.from_bytes(packet[header + 2 : header + 4]) == sink.port:
                marks.append(packet[1])
    assert set(marks) == {TrafficClass.BACKGROUND.tos}


def test_a_stream_that_breaks_is_opened_again() -> None:
    over = threading.Event()
    with socket.create_server((HOST, 0)) as listener:
        listener.settimeout(WAIT_S)
        sender = Source(HOST, listener.getsockname()[1], WAIT_S, lambda: not over.is_set())
        with in_background(lambda: sender.stream(1e6)):
            try:
                for _ in range(2):
                    connection, _ = listener.accept()
                    with connection:
                        assert connection.recv(1)
            finally:
                over.set()


def drain(connection: socket.socket) -> None:
    while connection.recv(1 << 20):
        pass


def test_a_stream_that_nobody_reads_ends_in_time_and_leaves_nothing_to_send() -> None:
    with socket.create_server((HOST, 0)) as listener:
        Source(HOST, listener.getsockname()[1], 0.3).stream(1e9)
        connection, _ = listener.accept()
        with connection, pytest.raises(ConnectionResetError):
            drain(connection)


def test_a_sink_under_a_flood_serves_the_stream_too() -> None:
    over = threading.Event()
    with Sink(HOST, 0) as sink:
        sender = Source(HOST, sink.port, WAIT_S, lambda: not over.is_set())
        with sending(sender, over, udp_bps=300e6, tcp_bps=1e6):
            take_both(sink)


def test_a_source_ends_with_its_parent() -> None:
    code = (
        "import os, subprocess, sys\n"
        "process = subprocess.Popen([*sys.argv[1:], '--parent', str(os.getpid())])\n"
        "os._exit(0)"
    )
    numbers = ("--port", str(free_port()), "--rate-bps", "1e5", "--seconds", "600")
    # The source holds the pipe of its parent open until it ends itself.
    status, out, _ = ended(start(sys.executable, "-c", code, *SOURCE, *numbers))
    assert status == 0
    assert "udp" in json.loads(out)


def test_a_port_that_is_taken_is_told_of() -> None:
    with socket.create_server((HOST, 0)) as other:
        port = str(other.getsockname()[1])
        status, out, err = ended(start(*SINK, "--port", port, "--seconds", "1"))
    assert (status, out) == (1, "")
    assert f"port {port} on {HOST}" in err


@pytest.mark.parametrize(
    "options",
    [
        (*SOURCE, "--port", "9", "--seconds", "1", "--rate-bps", "0"),
        (*SOURCE, "--port", "9", "--seconds", "inf", "--rate-bps", "1e6"),
        (*SOURCE, "--port", "70000", "--seconds", "1", "--rate-bps", "1e6"),
        (*SINK, "--port", "0", "--seconds", "nan"),
    ],
)
def test_what_has_no_bounds_is_wrong_usage(options: tuple[str, ...]) -> None:
    status, out, err = ended(start(*options))
    assert (status, out) == (2, "")
    assert "error: --port must be" in err
