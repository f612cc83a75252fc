"""The supervisor's processes: started in their namespaces, started again when they end."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from deploy.environments import inherited
from deploy.netns import network
from deploy.netns.log_files import rotate_logs
from deploy.roster import Service
from deploy.runtime import ProcessState
from swarm.log import Logger

FIRST_DELAY_S = 0.5
MAX_DELAY_S = 10.0
SETTLED_S = 30.0
"""A process that ran this long starts with the first delay again when it ends."""
WATCH_S = 5.0
HELD_S = 30.0
"""A process that was stopped (SIGSTOP) for so long is ended, so that it is started again."""
POLITE_S = 5.0
"""How long processes may take to end after SIGTERM."""
ROUTER_POLITE_S = 2.0


class ChildStatus(msgspec.Struct, frozen=True):
    """One process as it travels over the control socket."""

    service: str
    state: ProcessState
    restarts: int
    uptime_s: float
    detail: str


@dataclass(slots=True)
class _Child:
    service: Service
    pid: int | None = None
    begun: float = 0.0
    restarts: int = 0
    delay_s: float = FIRST_DELAY_S
    detail: str = ""
    held_since: float | None = None
    """Since when it has been seen stopped."""
    retry: asyncio.TimerHandle | None = field(default=None, repr=False)


class Children:
    """All processes of one swarm. Used on the thread of one event loop, in the process that is
    PID 1 of its PID namespace: it also reaps what its processes leave behind."""

    def __init__(self, members: tuple[Service, ...], logs: Path, log: Logger) -> None:
        self._children = {service.name: _Child(service) for service in members}
        self._by_pid: dict[int, _Child] = {}
        self._logs = logs
        self._log = log
        self._stopping = False
        self._emptied = asyncio.Event()

    def start(self) -> None:
        """Starts every process. Raises OSError when a log cannot be written or a program is not
        there."""
        asyncio.get_running_loop().add_signal_handler(signal.SIGCHLD, self._reap)
        for child in self._children.values():
            self._spawn(child)
        asyncio.get_running_loop().call_later(WATCH_S, self._watch)

    def status(self) -> tuple[ChildStatus, ...]:
        """All processes, in the order in which they were given."""
        now = time.monotonic()
        return tuple(
            ChildStatus(
                service=name,
                state=self._state(child),
                restarts=child.restarts,
                uptime_s=round(now - child.begun, 3) if child.pid is not None else 0.0,
                detail=child.detail,
            )
            for name, child in self._children.items()
        )

    def kill(self, service: str, number: int) -> None:
        """Sends a signal to a process. Raises KeyError for an unknown one, ProcessLookupError
        for one that does not run."""
        pid = self._children[service].pid
        if pid is None:
            raise ProcessLookupError(service)
        os.kill(pid, number)

    async def stop(self) -> None:
        """Ends all processes: SIGTERM, then SIGKILL for those that do not end in time."""
        self._stopping = True
        for child in self._children.values():
            if child.retry is not None:
                child.retry.cancel()
        # The router last: a process that loses it first would wait to say goodbye.
        routers = [c for c in self._children.values() if c.service.role == "router"]
        others = [c for c in self._children.values() if c.service.role != "router"]
        await self._end(others, POLITE_S)
        await self._end(routers, ROUTER_POLITE_S)

    async def _end(self, group: list[_Child], polite_s: float) -> None:
        for number, patience_s in ((signal.SIGTERM, polite_s), (signal.SIGKILL, 1.0)):
            for child in group:
                if child.pid is not None:
                    os.kill(child.pid, number)
            deadline = time.monotonic() + patience_s
            while any(child.pid is not None for child in group):
                self._emptied.clear()
                try:
                    await asyncio.wait_for(self._emptied.wait(), deadline - time.monotonic())
                except TimeoutError:
                    break

    def _spawn(self, child: _Child) -> None:
        service = child.service
        child.retry = None
        log = os.open(
            self._logs / f"{service.name}.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644
        )
        argv = (*network.enter(service.host), *service.argv)
        try:
            child.pid = os.posix_spawnp(
                argv[0],
                argv,
                {**inherited(service.role, os.environ), **service.env},
                file_actions=[
                    (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                    (os.POSIX_SPAWN_DUP2, log, 1),
                    (os.POSIX_SPAWN_DUP2, log, 2),
                ],
                setsigdef=[signal.SIGPIPE],
            )
        finally:
            os.close(log)
        child.begun, child.held_since = time.monotonic(), None
        self._by_pid[child.pid] = child
        self._log.info("started", service=service.name, pid=child.pid)

    def _reap(self) -> None:
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                break
            if pid == 0:
                break
            child = self._by_pid.pop(pid, None)
            if child is not None:
                self._ended(child, os.waitstatus_to_exitcode(status))
        self._emptied.set()

    def _ended(self, child: _Child, code: int) -> None:
        child.pid = None
        how = f"signal {-code}" if code < 0 else f"exit status {code}"
        child.detail = f"last ended with {how}"
        self._log.info("ended", service=child.service.name, how=how)
        if self._stopping or child.service.restart == "no":
            return
        if time.monotonic() - child.begun > SETTLED_S:
            child.delay_s = FIRST_DELAY_S
        child.restarts += 1
        self._start_later(child)

    def _start_later(self, child: _Child) -> None:
        loop = asyncio.get_running_loop()
        child.retry = loop.call_later(child.delay_s, self._again, child)
        child.delay_s = min(child.delay_s * 2, MAX_DELAY_S)

    def _again(self, child: _Child) -> None:
        try:
            self._spawn(child)
        except OSError as error:
            child.detail = f"cannot be started again: {error}"
            self._log.error("not_started", service=child.service.name, error=str(error))
            self._start_later(child)

    def _watch(self) -> None:
        """Ends processes that somebody has stopped and nobody lets go on, and rotates logs."""
        if self._stopping:
            return
        asyncio.get_running_loop().call_later(WATCH_S, self._watch)
        rotate_logs(self._logs)
        now = time.monotonic()
        for child in self._children.values():
            if child.pid is None or not _is_stopped(child.pid):
                child.held_since = None
            elif child.held_since is None:
                child.held_since = now
            elif now - child.held_since >= HELD_S:
                self._log.error("held", service=child.service.name, seconds=HELD_S)
                os.kill(child.pid, signal.SIGKILL)

    @staticmethod
    def _state(child: _Child) -> ProcessState:
        if child.pid is not None:
            return "running"
        return "restarting" if child.retry is not None else "stopped"


def _is_stopped(pid: int) -> bool:
    """Whether the process is stopped by a signal."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    # The program's name, in parentheses, may hold anything.
    return stat.rpartition(")")[2].split()[0] == "T"
