"""Three machines on one: network namespaces on a bridge, each with a router of its own.

Call it as root of new network, mount and process namespaces (`stage.inside`): all of it goes with
them. The bridge is the switch; who measures sits beside it, with an address of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from deploy.netns.network import run
from deploy.trust.keystore import Keystore
from swarm.defaults import ROUTER_PORT
from swarm.errors import TransportError
from swarm.session import Session

SWARM = "site"
HOSTS = ("A", "B", "C")
BRIDGE, OBSERVER = "site0", "10.77.0.254"
CONNECT_S = 30.0
END_S = 15.0


def address(host: str) -> str:
    """A machine's own."""
    return f"10.77.0.{1 + HOSTS.index(host)}"


def place(host: str) -> str:
    """A machine's router, as it is typed."""
    return f"tls/{address(host)}:{ROUTER_PORT}"


def device(host: str) -> str:
    """The switch's end of a machine's cable."""
    return f"port-{host}"


@dataclass
class Site:
    """The machines, and what runs on them."""

    folder: Path
    store: Keystore
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def identity(self, name: str) -> Path:
        """The folder of a role's identity, which it would have been brought on its machine."""
        return self.store.identity(name).folder

    def start(self, host: str, name: str, *argv: str, **settings: object) -> None:
        """Runs `python -m ARGV` on a machine, with these settings and no others."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith("COADAPT_")}
        given = {f"COADAPT_{key.upper()}": str(value) for key, value in settings.items()}
        with open(self.folder / f"{name}.log", "ab") as log:
            self.processes[name] = subprocess.Popen(
                ["ip", "netns", "exec", host, sys.executable, "-m", *argv],
                env={**kept, "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1", **given},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def router(self, host: str, peers: Sequence[str]) -> None:
        """Starts a machine's router, which reaches those of other machines by itself."""
        words = [word for peer in peers for word in ("--peer", place(peer))]
        identity = self.identity(f"router-{host}")
        where = ["--listen", address(host), "--cert", str(identity)]
        self.start(host, f"router-{host}", "coadapt.main", "router", *where, *words, "--scouting")

    def join(self, host: str, robot: str, where: str = "", **settings: object) -> None:
        """Starts a robot as a person would on its machine; `where` to reach its router otherwise
        than by its address."""
        self.start(
            host,
            f"robot-{robot}",
            *("coadapt.main", "join", where or place(host), "--robot", robot),
            *("--cert", str(self.identity(robot)), "--rings", "16", "--metrics", "127.0.0.1:0"),
            **settings,
        )

    def ego(self, host: str, robot: str, world: Mapping[str, object], **settings: object) -> None:
        """Starts an ego by hand."""
        router = f"{place(host)}#identity={self.identity(f'ego-{robot}')}"
        journal = self.folder / f"{robot}.jsonl"
        common = {"swarm": SWARM, "router": router, "metrics_port": 0, "journal": journal}
        self.start(host, f"ego-{robot}", "ego_agent", **common, ego=robot, **world, **settings)

    def stop(self, *names: str) -> None:
        """Ends processes, and waits until they have ended."""
        ending = [self.processes.pop(name) for name in names]
        for process in ending:
            process.terminate()
        for process in ending:
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def observer(self, host: str = "A", name: str = "reader-bench") -> Session:
        """A session of who measures, at a machine's router. Raises TransportError."""
        router = f"{place(host)}#identity={self.identity(name)}"
        try:
            return Session(router, SWARM, timeout_s=CONNECT_S)
        except TransportError as error:
            said = self.log(f"router-{host}")
            raise TransportError(f"{error}; the router said: {said}") from error

    def cut(self, host: str) -> None:
        """Pulls a machine's cable out of the switch: packets vanish, and no process is told."""
        run("ip", "link", "set", device(host), "nomaster")

    def heal(self, host: str) -> None:
        """Puts it back."""
        run("ip", "link", "set", device(host), "master", BRIDGE)

    def narrow(self, host: str, mtu: int) -> None:
        """Has the switch drop what is larger on its way from a machine, which is not told."""
        # Packets that the kernel would cut up later pass a switch of the kernel's own.
        run("ip", "-n", host, "link", "set", "eth0", "gso_max_segs", "1")
        for other in HOSTS:
            if other != host:
                # Of what the machine's own cable drops its kernel is told, and sends it anew.
                run("ip", "link", "set", device(other), "mtu", str(mtu))

    def log(self, name: str) -> str:
        """The end of what a process has written."""
        path = self.folder / f"{name}.log"
        return path.read_text(errors="replace")[-2000:] if path.exists() else ""

    def bytes_of(self, host: str) -> int:
        """All that has passed a machine's cable, both ways, since it was laid."""
        (facts,) = json.loads(run("ip", "-j", "-s", "link", "show", "dev", device(host)))
        return int(facts["stats64"]["rx"]["bytes"]) + int(facts["stats64"]["tx"]["bytes"])


@contextmanager
def site(folder: Path, robots: Sequence[str], egos: Sequence[str]) -> Iterator[Site]:
    """The machines with their cables, and certificates for these robots, egos and an observer."""
    # `ip netns` keeps its names in /run, which an ordinary user cannot write.
    run("mount", "-t", "tmpfs", "-o", "mode=755", "tmpfs", "/run")
    lines = [
        "link set lo up",
        f"link add {BRIDGE} type bridge",
        f"addr add {OBSERVER}/24 dev {BRIDGE}",
        f"link set {BRIDGE} up",
    ]
    for host in HOSTS:
        lines += [
            f"netns add {host}",
            f"link add {device(host)} type veth peer name eth0 netns {host}",
            f"link set {device(host)} master {BRIDGE} up",
        ]
    run("ip", "-batch", "-", text="\n".join(lines))
    for host in HOSTS:
        inside = f"link set lo up\naddr add {address(host)}/24 dev eth0\nlink set eth0 up"
        run("ip", "-n", host, "-batch", "-", text=inside)
    store = Keystore(folder / "keystore")
    store.init(SWARM)
    for host in HOSTS:
        store.issue(f"router-{host}", (address(host),))
    names = [*robots, *(f"ego-{ego}" for ego in egos), "reader-bench", "operator-bench"]
    for name in names:
        store.issue(name)
    with ExitStack() as stack:
        made = Site(folder, store)
        stack.callback(lambda: made.stop(*made.processes))
        yield made
