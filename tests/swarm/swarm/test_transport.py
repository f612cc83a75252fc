"""Configurations of routers and clients, and opening sessions that may not open."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import zenoh

from swarm import zenoh_config
from swarm.errors import SettingError, TransportError
from swarm.session import Session
from swarm.traffic import LINKS, TrafficClass
from tests.support.free_ports import free_ports
from tests.support.zenoh_fixtures import WAIT_S, RouterProcess, until


def test_the_printed_configuration_is_one_that_zenoh_reads(tmp_path: Path) -> None:
    printed = subprocess.run(
        [
            *(sys.executable, "-m", "swarm.router", "--print-config"),
            *("--host", "0.0.0.0", "--port", "7447", "--unix-socket", "/run/coadapt/r.sock"),
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    file = tmp_path / "router.json5"
    file.write_text(printed)
    config = zenoh.Config.from_file(str(file))
    assert config.get_json("mode") == '"router"'
    assert json.loads(config.get_json("transport/unicast/max_links")) > LINKS
    endpoints = json.loads(config.get_json("listen/endpoints"))
    assert endpoints == [
        "tcp/0.0.0.0:7447?prio=1-3;rel=1#dscp=0xb8;so_sndbuf=16384",
        "tcp/0.0.0.0:7448?prio=4-5;rel=1#dscp=0x88",
        "tcp/0.0.0.0:7449?prio=6-7;rel=1#dscp=0x20",
        "unixsock-stream//run/coadapt/r.sock",
    ]


def test_a_router_serves_from_a_configuration_file(tmp_path: Path) -> None:
    port = free_ports(3)
    file = tmp_path / "router.json5"
    file.write_text(zenoh_config.router_json5(zenoh_config.router_config("127.0.0.1", port)))
    command = [sys.executable, "-m", "swarm.router", "--config", str(file)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as router:
        try:
            assert router.stderr is not None
            assert "router_up" in router.stderr.readline()
            with Session(f"tcp/127.0.0.1:{port}", "s", timeout_s=10) as session:
                assert session.links() == LINKS
        finally:
            router.terminate()
        router.stderr.read()
        assert router.wait(WAIT_S) == 0


def test_the_priorities_of_the_classes_cover_all_and_do_not_overlap() -> None:
    ranges = [cls.value.priorities for cls in TrafficClass]
    covered = [priority for low, high in ranges for priority in range(low, high + 1)]
    assert sorted(covered) == list(range(1, 8))
    for cls in TrafficClass:
        low, high = cls.value.priorities
        assert low <= cls.value.priority <= high


@pytest.mark.parametrize(
    "router", ["", "localhost", "tcp/host", "tcp/host:0", "tcp/host:65534", "udp/h:1", "tcp/a b:1"]
)
def test_a_malformed_router_is_refused_with_what_is_allowed(router: str) -> None:
    with pytest.raises(SettingError, match=r"it must be tcp/HOST:PORT, tls/.* or unixsock"):
        Session(router, "s")


def test_a_unix_socket_path_that_is_too_long_is_refused() -> None:
    with pytest.raises(SettingError, match="longer than"):
        zenoh_config.router_config("127.0.0.1", 7447, "/" + "x" * 200)


def test_a_router_whose_port_is_taken_says_so_and_exits_with_1(
    shared_router: RouterProcess,
) -> None:
    command = [sys.executable, "-m", "swarm.router", "--port", str(shared_router.port)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert str(shared_router.port) in done.stderr.splitlines()[-1]


def test_an_unreadable_router_configuration_is_named(tmp_path: Path) -> None:
    file = tmp_path / "router.json5"
    file.write_text("{")
    command = [sys.executable, "-m", "swarm.router", "--config", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert str(file) in done.stderr


def test_a_session_without_a_router_gives_up_after_its_time() -> None:
    with pytest.raises(TransportError, match="cannot open"):
        Session(f"tcp/127.0.0.1:{free_ports(3)}", "s", timeout_s=0.2)


def test_a_session_that_waits_for_its_router_can_be_stopped() -> None:
    stop = threading.Event()
    failed: list[BaseException] = []

    def wait() -> None:
        try:
            Session(f"tcp/127.0.0.1:{free_ports(3)}", "s", stop=stop)
        except TransportError as error:
            failed.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    stop.set()
    thread.join(WAIT_S)
    assert not thread.is_alive()
    assert "stopped" in str(failed[0])


def test_a_session_whose_packets_vanish_can_be_stopped() -> None:
    stop = threading.Event()
    timer = threading.Timer(0.3, stop.set)
    timer.start()
    begun = time.monotonic()
    # TEST-NET-1 (RFC 5737): nobody answers, or the route is missing; both must be left.
    with pytest.raises(TransportError):
        Session("tcp/192.0.2.1:7447", "s", stop=stop)
    assert time.monotonic() - begun < WAIT_S
    timer.join()


def test_a_session_waits_for_a_router_that_starts_later(own_router: RouterProcess) -> None:
    own_router.stop()
    starter = threading.Thread(target=own_router.start)
    starter.start()
    with Session(own_router.address, "s", timeout_s=WAIT_S) as session:
        # They come one after the other.
        until(lambda: session.links() == LINKS, "all links are up")
    starter.join()
