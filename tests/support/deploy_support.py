"""What the tests of running swarms share."""

from __future__ import annotations

import contextlib
import functools
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from deploy import state as record
from deploy.runtimes.netns import LAUNCHER
from deploy.spec import SwarmSpec

WAIT_S = 60.0
T = TypeVar("T")


def await_(probe: Callable[[], T], what: str, timeout_s: float = WAIT_S) -> T:
    """The first true value; what is awaited with it has no event that could be waited for."""
    deadline = time.monotonic() + timeout_s
    while not (value := probe()):
        assert time.monotonic() < deadline, f"not within {timeout_s} s: {what}"
        time.sleep(0.1)
    return value


def processes_of(spec: SwarmSpec) -> list[str]:
    """Command lines of all processes of this machine that belong to a swarm."""
    marks = (f"COADAPT_SWARM={spec.swarm}\0", f"{spec.run_dir}/", f"{spec.run_dir}\0")
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            text = (entry / "cmdline").read_text(errors="replace") + "\0"
            environment = (entry / "environ").read_text(errors="replace")
            if any(mark in text or mark in environment for mark in marks):
                found.append(text.replace("\0", " "))
    return found


def supervisor_of(spec: SwarmSpec) -> int:
    """The supervisor's process id on this machine."""
    launcher = record.need_state(spec.swarm).processes[LAUNCHER].pid
    return int(Path(f"/proc/{launcher}/task/{launcher}/children").read_text())


def network_of(pid: int) -> str:
    return os.readlink(f"/proc/{pid}/ns/net")


def networks_in_use() -> set[str]:
    found = set()
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            found.add(network_of(int(entry.name)))
    return found


def assert_nothing_is_left(spec: SwarmSpec, network: str) -> None:
    await_(lambda: not processes_of(spec), "every process of the swarm is gone")
    assert network not in networks_in_use()
    interfaces = {name for _, name in socket.if_nameindex()}
    assert not interfaces & {"coadapt0", "link1", "link2"}
    for port in (spec.prometheus_port, spec.ego_metrics_port, spec.qod_port):
        # The kernel empties a dying process's environment before it closes its sockets.
        await_(functools.partial(is_free, port), f"port {port} is free")


def is_free(port: int) -> bool:
    """Whether a server could listen to a port of this machine's loopback."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
