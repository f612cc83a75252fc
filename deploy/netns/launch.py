"""Starting the supervisor in new namespaces, and the relay beside it."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec

from deploy.netns import control, detached, outside
from deploy.netns.supervisor import (
    CLASS_SOCKETS,
    CONSOLE_SOCKET,
    EGO_METRICS_SOCKET,
    LLM_HTTP_SOCKET,
    PROMETHEUS_SOCKET,
    QOD_SOCKET,
)
from deploy.ports import ROUTER, Endpoint
from deploy.spec import SwarmSpec
from deploy.state import ProcessMark
from swarm.errors import DeployError
from swarm.traffic import TrafficClass
from swarm.zenoh_config import CONTROL_BUFFER_BYTES

START_S = 30.0
START_S_A_ROBOT = 0.5
_LIMITS = (
    "kernel/unprivileged_userns_clone",
    "kernel/apparmor_restrict_unprivileged_userns",
    "user/max_user_namespaces",
)


def _unshare() -> list[str]:
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    inner = ["--net", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"]
    return ["unshare", *user, *inner]


def why_not() -> str | None:
    """None when this user may make the namespaces here, else the reason and what would help."""
    command = [*_unshare(), "ip", "link", "add", "probe0", "type", "bridge"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    except FileNotFoundError:
        return "the program `unshare` is missing; install the package util-linux"
    except subprocess.TimeoutExpired:
        return "`unshare` did not answer within 20 s"
    if done.returncode == 0:
        return None
    words = done.stderr.strip() or f"exit status {done.returncode}"
    return f"namespaces cannot be made here: {words}. {_limits()}"


def _limits() -> str:
    found = []
    for name in _LIMITS:
        with contextlib.suppress(OSError):
            found.append(f"{name.replace('/', '.')}={Path('/proc/sys', name).read_text().strip()}")
    return (
        "An ordinary user needs user namespaces (sysctl kernel.unprivileged_userns_clone=1, "
        "kernel.apparmor_restrict_unprivileged_userns=0 where they exist, and "
        f"user.max_user_namespaces > 0; here: {', '.join(found) or 'none readable'}); the package "
        "iproute2 must be there; or run as root, or with RUNTIME=docker"
    )


class Launch:
    """A supervisor that waits, in its namespaces, to be told what to run."""

    def __init__(self, log: Path) -> None:
        """Starts it; its own log goes to the given file."""
        spec_out, self._spec = os.pipe()
        self._ready, ready_in = os.pipe()
        log_file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        argv = [*_unshare(), sys.executable, "-m", "deploy.netns.supervisor"]
        try:
            self.mark: ProcessMark = detached.spawn(argv, {0: spec_out, 1: ready_in, 2: log_file})
        except DeployError:
            self.close()
            raise
        finally:
            for descriptor in (spec_out, ready_in, log_file):
                os.close(descriptor)

    def start(self, spec: SwarmSpec) -> None:
        """Has the swarm started. Raises DeployError with the supervisor's reason when it fails."""
        with open(self._spec, "wb", closefd=False) as stream:
            stream.write(msgspec.json.encode(spec))
        self._close_spec()
        patience_s = START_S + START_S_A_ROBOT * len(spec.robots)
        readable, _, _ = select.select([self._ready], [], [], patience_s)
        if not readable:
            raise DeployError(f"the supervisor did not start the swarm within {patience_s:.0f} s")
        line = os.read(self._ready, 65536)
        if not line:
            raise DeployError("the supervisor ended before it had started the swarm")
        error = msgspec.json.decode(line, type=control.Reply).error
        if error:
            raise DeployError(error)

    def _close_spec(self) -> None:
        if self._spec >= 0:
            os.close(self._spec)
            self._spec = -1

    def close(self) -> None:
        """Lets go of the supervisor; one that has not been told what to run ends."""
        self._close_spec()
        if self._ready >= 0:
            os.close(self._ready)
            self._ready = -1


_SOCKETS: Mapping[Endpoint, str] = {
    "ego metrics": EGO_METRICS_SOCKET,
    "prometheus": PROMETHEUS_SOCKET,
    "qod": QOD_SOCKET,
    "llm": LLM_HTTP_SOCKET,
    "console": CONSOLE_SOCKET,
    **dict(zip(ROUTER, CLASS_SOCKETS.values(), strict=True)),
}
_CLASSES: Mapping[Endpoint, TrafficClass] = dict(zip(ROUTER, TrafficClass, strict=True))


def start_relay(
    spec: SwarmSpec, log: Path, listeners: Mapping[Endpoint, socket.socket]
) -> ProcessMark:
    """Starts the host's relay on listening sockets, which the caller may close afterwards; it is
    also the gateway's way to a model server outside."""
    for endpoint, cls in _CLASSES.items():
        if endpoint in listeners:
            _mark(listeners[endpoint], cls)
    endpoints = [(listener, _SOCKETS[endpoint]) for endpoint, listener in listeners.items()]
    pairs = [f"{3 + i}={spec.run_dir}/{path}" for i, (_, path) in enumerate(endpoints)]
    server = spec.llm_server()
    if server is not None:
        host, port = server
        pairs.append(f"{spec.run_dir}/{outside.SERVER_SOCKET}={host}:{port}")
    with open(os.devnull) as nothing, open(log, "ab") as log_file:
        descriptors = {0: nothing.fileno(), 1: log_file.fileno(), 2: log_file.fileno()}
        descriptors |= {3 + i: endpoint.fileno() for i, (endpoint, _) in enumerate(endpoints)}
        argv = [sys.executable, "-m", "deploy.netns.relay", spec.run_dir, *pairs]
        return detached.spawn(argv, descriptors)


def _mark(listener: socket.socket, cls: TrafficClass) -> None:
    """Has what leaves by a listener's connections marked as what the router itself sends is."""
    listener.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, cls.tos)
    if cls is TrafficClass.CONTROL:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, CONTROL_BUFFER_BYTES)
