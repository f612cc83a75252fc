"""Several Docker engines on one machine: each in namespaces of its own, a bridge as their wire.

Everything lives in one new PID namespace: when its first process ends, by whatever, the kernel ends
every engine and container in it, and the links and mounts go with the last of them.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tests.support.deploy_support import await_

NEEDED = (
    *("dockerd", "docker-init", "docker-registry"),
    *("nsenter", "setpriv", "unshare", "ip", "iptables"),
)
"""Programs; Debian's docker.io and docker-registry bring what a machine with Docker may lack."""
FIRST = ("docker-init", "--", "sleep", "infinity")
"""The first process inside, which takes up those whose parents have ended."""
NETWORK = "10.77.0"
HUB = f"{NETWORK}.254"
REGISTRY = f"{HUB}:5000"
_SHARED = (
    "mkdir -p {ours}/overlay2 && cp -a {theirs}/image {ours} && cd {theirs}/overlay2"
    # The engine would do both itself, over the layers.
    " && mount --bind --make-shared {ours} {ours}"
    " && mount --bind {ours}/overlay2 {ours}/overlay2 && cp -a l {ours}/overlay2"
    " && for layer in */diff; do to={ours}/overlay2/$(dirname $layer); mkdir -p $to/diff $to/work"
    " && find $(dirname $layer) -maxdepth 1 -type f -exec cp -a -t $to {{}} +"
    " && mount --bind $layer $to/diff; done"
)
"""Gives an engine another one's images: copies of what tells of layers, and the layers by mounts,
for they are a hundred thousand files."""
ENGINE_S = 60.0
COMMAND_S = 600.0


def why_not() -> str | None:
    """None where several engines can be run, else what is missing."""
    if os.geteuid() != 0:
        return "several Docker engines need root"
    missing = [program for program in NEEDED if shutil.which(program) is None]
    if missing:
        return f"several Docker engines need {', '.join(missing)}"
    probe = subprocess.run(
        ["unshare", "--net", "--", "sh", "-c", "ip link add v type vxlan id 1 dstport 4789"],
        capture_output=True,
        text=True,
        check=False,
    )
    return f"this kernel has no VXLAN: {probe.stderr.strip()}" if probe.returncode else None


@dataclass(frozen=True, slots=True)
class Node:
    """One machine with an engine: `name`, which is its host name, and its address on the wire."""

    name: str
    address: str
    pid: int
    """A process in its namespaces."""
    socket: Path

    def docker(
        self, *arguments: str, stdin: str | None = None, source: IO[bytes] | None = None
    ) -> str:
        """What a command of Docker's says at this node, which reads a text or what comes from a
        pipe. Raises AssertionError with its words."""
        return said(["docker", "--host", f"unix://{self.socket}", *arguments], stdin, source)

    def run(self, *argv: str) -> str:
        """What a program of this machine says in the node's network."""
        return said(["nsenter", f"--net=/proc/{self.pid}/ns/net", "--", *argv])


class Site:
    """A wire with a registry at `REGISTRY`, and nodes that are added one by one."""

    def __init__(self, folder: Path, images: Path) -> None:
        """`images`: the registry's storage, which may outlive this."""
        self._folder = folder
        self.group = f"coadapt-site-{os.getpid()}"
        self.nodes: list[Node] = []
        self.pid = 0
        self._processes: list[subprocess.Popen[bytes]] = []
        own = ("--pid", "--net", "--mount", "--uts", "--mount-proc", "--fork", "--kill-child")
        self._first = subprocess.Popen(
            # All of it ends with whoever started it, too.
            ["setpriv", "--pdeathsig", "KILL", "unshare", *own, "--", *FIRST],
            start_new_session=True,
        )
        try:
            self._build(images)
        except BaseException:
            self.close()
            raise

    def _build(self, images: Path) -> None:
        children = Path(f"/proc/{self._first.pid}/task/{self._first.pid}/children")
        self.pid = int(await_(lambda: children.read_text().strip(), "the namespaces are there"))
        self._inside = ("nsenter", f"--target={self.pid}", "--net", "--mount", "--pid", "--uts")
        # No default route: what tries to leave is told so at once.
        self.sh(
            "mount -t tmpfs tmpfs /run && ip link set lo up"
            " && ip link add wire type bridge && ip link set wire up"
            f" && ip address add {HUB}/24 dev wire"
        )
        self._start_registry(images)

    def sh(self, script: str) -> str:
        """What a shell says in the site's namespaces."""
        return said([*self._inside, "--", "sh", "-ec", script])

    def add(self, name: str, images_of: Node | None = None) -> Node:
        """Starts one more engine, and waits until it answers. `images_of`: it has that node's
        images from the start, whose files engines never write."""
        number = len(self.nodes) + 1
        address = f"{NETWORK}.{number}"
        folder = self._folder / name
        folder.mkdir()
        socket = folder / "docker.sock"
        pid_file = folder / "pid"
        script = (
            f"echo $$ > {pid_file}; hostname {name}; mount -t tmpfs tmpfs /run"
            " && mount -t sysfs sysfs /sys && mount --rbind $CGROUPS /sys/fs/cgroup"
            " && ip link set lo up"
            f" && until ip link show eth0 >/dev/null 2>&1; do sleep 0.05; done"
            f" && ip address add {address}/24 dev eth0 && ip link set eth0 up"
            f" && exec dockerd --data-root {folder}/data --exec-root /run/docker"
            f" --pidfile /run/docker.pid --host unix://{socket}"
            f" --cgroup-parent /{self.group} --insecure-registry {REGISTRY}"
            " --log-level warn"
        )
        # The new /sys covers the groups' mounts: they are bound to a place of their own before.
        before = f"mkdir -p {folder}/groups && mount --rbind /sys/fs/cgroup {folder}/groups"
        if images_of is not None:
            theirs = self._folder / images_of.name / "data"
            before += f"; {_SHARED.format(theirs=theirs, ours=folder / 'data')}"
        with open(folder / "dockerd.log", "wb") as log:
            own = ("--", "unshare", "--net", "--mount", "--uts", "--", "sh", "-ec")
            told = f"{before}; CGROUPS={folder}/groups; {script}"
            self._begin([*self._inside, *own, told], log)
        inside = int(await_(lambda: pid_file.exists() and pid_file.read_text().strip(), "a node"))
        pid = self._outer(inside)
        self.sh(
            f"ip link add {name} type veth peer name eth0 netns {inside}"
            f" && ip link set {name} master wire up"
        )
        node = Node(name, address, pid, socket)
        try:
            await_(lambda: answers(node), f"the engine of {name} answers", ENGINE_S)
        except AssertionError as error:
            tail = (folder / "dockerd.log").read_text(errors="replace").splitlines()[-10:]
            raise AssertionError("\n".join([str(error), *tail])) from None
        self.nodes.append(node)
        return node

    def stop_registry(self) -> None:
        """Ends the registry: nothing answers at `REGISTRY` any more."""
        self.sh(f"kill $(cat {self._folder}/registry.pid)")
        self._registry.wait()

    def cut(self, node: Node, *, whole: bool = False) -> None:
        """Takes a node off the wire, or, `whole`, puts it back."""
        self.sh(f"ip link set {node.name} {'up' if whole else 'down'}")

    def close(self) -> None:
        """Ends every process of it; returns when they and their control groups are gone."""
        # Its first process goes with it.
        self._first.kill()
        for process in (self._first, *self._processes):
            process.wait()
        for group in Path("/sys/fs/cgroup").glob(f"*/{self.group}"):
            for path in sorted(group.rglob("*/"), reverse=True):
                _remove_group(path)
            _remove_group(group)

    def _outer(self, inside: int) -> int:
        """The number of a process of the site's as this machine has it."""
        for entry in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                lines = (entry / "status").read_text().splitlines()
                numbers = next(line for line in lines if line.startswith("NSpid:")).split()[1:]
                same = os.readlink(entry / "ns/pid") == os.readlink(f"/proc/{self.pid}/ns/pid")
                if same and numbers[-1] == str(inside):
                    return int(entry.name)
        raise AssertionError(f"process {inside} of the site is gone")

    def _start_registry(self, images: Path) -> None:
        config = self._folder / "registry.yml"
        config.write_text(
            f"version: 0.1\nlog: {{level: warn}}\nhttp: {{addr: '{REGISTRY}'}}\n"
            f"storage: {{filesystem: {{rootdirectory: '{images}'}}}}\n"
        )
        with open(self._folder / "registry.log", "wb") as log:
            script = f"echo $$ > {self._folder}/registry.pid; exec docker-registry serve {config}"
            self._registry = self._begin([*self._inside, "--", "sh", "-ec", script], log)

    def _begin(self, argv: Sequence[str], log: IO[bytes]) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(argv, stdout=log, stderr=log)
        self._processes.append(process)
        return process


def publish(image: str, node: Node) -> None:
    """Has a node pull an image from the site's registry; where it is not there, the node gets it
    from this machine's engine and brings it there."""
    there = f"{REGISTRY}/{image}"
    with contextlib.suppress(AssertionError):
        node.docker("pull", "--quiet", there)
        return
    with subprocess.Popen(["docker", "save", image], stdout=subprocess.PIPE) as saved:
        node.docker("load", "--quiet", source=saved.stdout)
    node.docker("tag", image, there)
    node.docker("push", "--quiet", there)
    node.docker("image", "rm", image)


def answers(node: Node) -> bool:
    """Whether a node's engine does what it is asked."""
    with contextlib.suppress(AssertionError):
        return bool(node.docker("info", "--format", "{{.ServerVersion}}"))
    return False


def said(argv: Sequence[str], stdin: str | None = None, source: IO[bytes] | None = None) -> str:
    """A program's standard output. Raises AssertionError with its words where it fails."""
    done = subprocess.run(
        argv,
        **({"stdin": source} if source is not None else {"input": stdin}),
        capture_output=True,
        text=True,
        timeout=COMMAND_S,
        check=False,
    )
    assert done.returncode == 0, f"{' '.join(argv[-6:])}: {done.stderr.strip()}"
    return done.stdout.strip()


@contextmanager
def site(images: Path) -> Iterator[Site]:
    """A `Site` for the block, in a folder of its own."""
    folder = tempfile.mkdtemp(prefix="cs-", dir="/tmp")
    try:
        made = Site(Path(folder), images)
        try:
            yield made
        finally:
            made.close()
    finally:
        # Images are very many files.
        said(["rm", "-rf", folder])


def _remove_group(path: Path) -> None:
    """A control group's directory, as soon as the kernel lets it go."""
    for _ in range(50):
        try:
            path.rmdir()
            return
        except FileNotFoundError:
            return
        except OSError:
            time.sleep(0.1)
