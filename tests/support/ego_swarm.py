"""Real processes of one swarm for the ego's tests: router, robots, egos on free ports."""

from __future__ import annotations

import os
import queue
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, TypeVar

import pytest

from perception.detector.backends import SETTING
from perception.fusion import detectors
from perception.kernels import library
from swarm import keyspace
from swarm.messages import Decision, Detections, Message
from swarm.session import Session
from tests.support.free_ports import free_ports

TIMEOUT_S = 60.0
T = TypeVar("T")


class MessageLog(Generic[T]):
    """Messages in the order of arrival; `until` waits for one."""

    def __init__(self) -> None:
        self.all: list[T] = []
        self._new: queue.SimpleQueue[T] = queue.SimpleQueue()

    def put(self, item: T) -> None:
        """Takes a message; safe on Zenoh's threads."""
        self.all.append(item)
        self._new.put(item)

    def until(self, wanted: Callable[[T], bool], timeout_s: float = TIMEOUT_S) -> T:
        """The next message that is wanted, from the first one not yet looked at on."""
        end = time.monotonic() + timeout_s
        last: T | None = None
        while (left := end - time.monotonic()) > 0:
            try:
                last = self._new.get(timeout=left)
            except queue.Empty:
                break
            if wanted(last):
                return last
        raise AssertionError(
            f"nothing wanted came in {timeout_s} s; last of {len(self.all)}: {last}"
        )

    def skip(self) -> None:
        """Looks only at what comes from now on."""
        while not self._new.empty():
            self._new.get()


class Swarm:
    """The processes of one swarm. Everything is killed at the end."""

    def __init__(self, world: Mapping[str, str], directory: Path) -> None:
        self.port = free_ports(3)
        self.python = sys.executable
        self.directory = directory
        self.address = f"tcp/127.0.0.1:{self.port}"
        self.processes: list[subprocess.Popen[bytes]] = []
        self.sessions: list[Session] = []
        self.env = {
            **{k: v for k, v in os.environ.items() if not k.startswith("COADAPT_")},
            "COADAPT_ROUTER": self.address,
            "COADAPT_SWARM": "test",
            "COADAPT_METRICS_PORT": "0",
            "COADAPT_EPOCH_NS": str(time.time_ns()),
            "OMP_NUM_THREADS": "1",
            "PYTHONUNBUFFERED": "1",
            **world,
        }

    def start(
        self, module: str, *arguments: str, logs: Path | None = None, **env: str
    ) -> subprocess.Popen[bytes]:
        """Starts `python -m module`; its logs go to a new file in the directory, or to `logs`."""
        if logs is None:
            handle, _ = tempfile.mkstemp(prefix=f"{module}-", suffix=".log", dir=self.directory)
        else:
            handle = os.open(logs, os.O_WRONLY)
        process = subprocess.Popen(
            [self.python, "-m", module, *arguments],
            env={**self.env, **{f"COADAPT_{k.upper()}": v for k, v in env.items()}},
            stdin=subprocess.DEVNULL,
            stdout=handle,
            stderr=handle,
        )
        os.close(handle)
        self.processes.append(process)
        return process

    def router(self) -> subprocess.Popen[bytes]:
        """Starts the router and waits until it listens."""
        process = self.start("swarm.router", "--port", str(self.port))
        until(lambda: _listens(self.port), "the router listens")
        return process

    def robot(self, *ids: str, **env: Any) -> subprocess.Popen[bytes]:
        """Starts one process with the given robots."""
        return self.start("robot_agent", robots=",".join(ids), **env)

    def ego(self, **env: Any) -> subprocess.Popen[bytes]:
        """Starts an ego."""
        return self.start("ego_agent", **env)

    def session(self) -> Session:
        """A session of the test's own, closed at the end."""
        session = Session(self.address, "test", timeout_s=TIMEOUT_S)
        self.sessions.append(session)
        return session

    def decisions(self, session: Session, ego: str) -> MessageLog[Decision]:
        """The decisions of an ego from now on."""
        return hear(session, keyspace.decision("test", ego), Decision)

    def detections(self, session: Session, ego: str) -> MessageLog[Detections]:
        """The fused frames of an ego from now on."""
        return hear(session, keyspace.detections("test", ego), Detections)

    def logs(self) -> str:
        """What all processes have written."""
        return "\n".join(p.read_text(errors="replace") for p in self.directory.glob("*.log"))

    def close(self) -> None:
        """Kills what still runs."""
        for session in self.sessions:
            session.close()
        for process in self.processes:
            if process.poll() is None:
                process.kill()
        for process in self.processes:
            process.wait(TIMEOUT_S)


def factory(scans: Path, robots: int = 2) -> dict[str, str]:
    """Settings of a small simulated world; `scans` keeps what was simulated for the next test."""
    return {
        "COADAPT_WORLD": "factory",
        "COADAPT_WORLD_ROBOTS": str(robots),
        "COADAPT_WORLD_RINGS": "16",
        "COADAPT_WORLD_CACHE": str(scans),
    }


def recorded(data: Path) -> dict[str, str]:
    """Settings of a recorded OPV2V world."""
    return {"COADAPT_WORLD": "opv2v", "COADAPT_WORLD_DATA": str(data)}


def float32() -> dict[str, str]:
    """The setting by which all processes compute alike: each would choose what is fastest, and in
    bfloat16 two that do so differ by rounding steps, now and then by a box."""
    return {SETTING: "compiled" if library.network() is not None else "torch"}


@contextmanager
def in_float32() -> Iterator[dict[str, str]]:
    """This process computes so, too, until left; gives the setting for others."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in float32().items():
            patch.setenv(name, value)
        detectors._learned.cache_clear()
        try:
            yield float32()
        finally:
            detectors._learned.cache_clear()


@contextmanager
def swarm_of(world: Mapping[str, str], directory: Path) -> Iterator[Swarm]:
    """A swarm that is gone at the end, whatever happens."""
    swarm = Swarm(world, directory)
    try:
        yield swarm
    finally:
        swarm.close()


M = TypeVar("M", bound=Message)


def hear(session: Session, key: str, kind: type[M]) -> MessageLog[M]:
    """The messages on a key from now on."""
    heard: MessageLog[M] = MessageLog()
    session.subscribe(key, kind, heard.put)
    return heard


def until(condition: Callable[[], bool], what: str, timeout_s: float = TIMEOUT_S) -> None:
    """Waits for something that no event tells: a port, a file."""
    waiting = threading.Event()
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, f"not within {timeout_s} s: {what}"
        waiting.wait(0.02)


def stop(process: subprocess.Popen[bytes]) -> int:
    """Ends a process as a service manager would; its exit status."""
    process.send_signal(signal.SIGTERM)
    return process.wait(TIMEOUT_S)


def metrics_of(port: int) -> dict[str, float]:
    """The samples that a process serves to Prometheus, by name and labels as written."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=TIMEOUT_S) as reply:
        lines = reply.read().decode().splitlines()
    samples = (line.rsplit(" ", 1) for line in lines if line and not line.startswith("#"))
    return {name: float(value) for name, value in samples}


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
