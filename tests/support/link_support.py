"""What the tests of drivers share: links of robots in namespaces of their own, and real traffic."""

from __future__ import annotations

import ctypes
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from network_controller.drivers.netns import NetnsDriver

CLONE_NEWNET = 0x40000000
_RECEIVE = """
import socket, sys
server = socket.create_server((sys.argv[1], 0))
print(server.getsockname()[1], flush=True)
peer, _ = server.accept()
while peer.recv(65536):
    pass
"""


@dataclass(frozen=True, slots=True)
class Links:
    """A bridge in this thread's namespace, and one robot namespace an address on it."""

    driver: NetnsDriver
    bridge: str
    robots: tuple[str, ...]

    def device(self, robot: str) -> str:
        """The bridge's end of a robot's link."""
        return f"link{self.robots.index(robot) + 1}"

    def again(self) -> NetnsDriver:
        """A driver that knows nothing of what others did."""
        return NetnsDriver("links", bridge=self.bridge)


def must(*argv: str, text: str = "") -> str:
    """The output of a command that has to succeed."""
    done = subprocess.run(argv, input=text, capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, f"{argv}: {done.stderr}"
    return done.stdout


def need_namespaces() -> None:
    """Skips a test that makes namespaces where they cannot be made."""
    if os.geteuid() != 0 or shutil.which("tc") is None or shutil.which("nsenter") is None:
        pytest.skip("namespaces of a test's own need root, iproute2 and nsenter")


@contextmanager
def links(robots: int = 2) -> Iterator[Links]:
    """Makes them, and moves this thread, and what it starts, into the bridge's namespace."""
    need_namespaces()
    mark = f"t{os.getpid()}"
    host, names = f"{mark}-host", tuple(f"{mark}-R{i + 1}" for i in range(robots))
    with ExitStack() as stack:
        for name in (host, *names):
            must("ip", "netns", "add", name)
            stack.callback(must, "ip", "netns", "del", name)
        stack.enter_context(entered(host))
        must("ip", "link", "add", "coadapt0", "type", "bridge")
        must("ip", "addr", "add", "10.77.0.1/16", "dev", "coadapt0")
        must("ip", "link", "set", "coadapt0", "up")
        for i, name in enumerate(names, start=1):
            add_link(f"link{i}", name, f"10.77.1.{i}")
        yield Links(NetnsDriver("links"), "coadapt0", names)


def add_link(device: str, robot: str, address: str) -> None:
    """A link between the bridge and a namespace."""
    must("ip", "link", "add", device, "type", "veth", "peer", "name", "eth0", "netns", robot)
    must("ip", "link", "set", device, "master", "coadapt0", "up")
    must("ip", "-n", robot, "addr", "add", f"{address}/16", "dev", "eth0")
    must("ip", "-n", robot, "link", "set", "eth0", "up")


@contextmanager
def entered(name: str) -> Iterator[None]:
    """This thread in another network namespace for a while."""
    libc = ctypes.CDLL(None, use_errno=True)
    here = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    there = os.open(Path("/run/netns", name), os.O_RDONLY)
    try:
        assert libc.setns(there, CLONE_NEWNET) == 0, os.strerror(ctypes.get_errno())
        yield
    finally:
        assert libc.setns(here, CLONE_NEWNET) == 0, os.strerror(ctypes.get_errno())
        os.close(here)
        os.close(there)


def send(links: Links, to: str, size: int, tos: int, *, frm: str = "") -> None:
    """Sends that many bytes by TCP with a mark, and waits until they have arrived; from the
    bridge's host when `frm` is empty, and to it when `to` is."""
    address = links.driver.robots()[to] if to else "10.77.0.1"
    receive_in(to, address, size, tos, frm=frm)


def receive_in(to: str, address: str, size: int, tos: int, *, frm: str = "") -> None:
    """The same between namespaces by name, to an address of the one; empty: this thread's."""
    receive_at, send_at = _enter(to), _enter(frm)
    with subprocess.Popen(
        [*receive_at, sys.executable, "-c", _RECEIVE, address], stdout=subprocess.PIPE, text=True
    ) as receiver:
        assert receiver.stdout is not None
        port = receiver.stdout.readline().strip()
        program = (
            "import socket, sys; s = socket.socket(); s.setsockopt(0, 1, int(sys.argv[3])); "
            "s.connect((sys.argv[1], int(sys.argv[2]))); s.sendall(bytes(int(sys.argv[4])))"
        )
        try:
            must(*send_at, sys.executable, "-c", program, address, port, str(tos), str(size))
            assert receiver.wait(timeout=30) == 0
        finally:
            receiver.kill()


def fill(address: str, size: int, tos: int) -> None:
    """Puts datagrams with a mark into the queue towards an address; nobody need receive them."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, tos)
        for _ in range(size // 1000):
            out.sendto(bytes(1000), (address, 9))


def _enter(robot: str) -> tuple[str, ...]:
    return ("nsenter", f"--net=/run/netns/{robot}") if robot else ()
