"""Processes on the host that outlive the command that started them."""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import time
from collections.abc import Mapping, Sequence

from deploy.state import ProcessMark
from swarm.errors import DeployError

_POLL_S = 0.05


def spawn(argv: Sequence[str], descriptors: Mapping[int, int]) -> ProcessMark:
    """Starts a program in a session of its own.

    Its descriptor `n` is the caller's `descriptors[n]`. Raises DeployError when it cannot be
    started.
    """
    # Copies above all targets, so that setting one target does not overwrite another's source.
    above = max(descriptors) + 1
    copies = {
        target: fcntl.fcntl(source, fcntl.F_DUPFD_CLOEXEC, above)
        for target, source in descriptors.items()
    }
    try:
        pid = os.posix_spawnp(
            argv[0],
            list(argv),
            os.environ,
            file_actions=[(os.POSIX_SPAWN_DUP2, copy, target) for target, copy in copies.items()],
            setsid=True,
            setsigdef=[signal.SIGPIPE, signal.SIGINT],
        )
    except OSError as error:
        raise DeployError(f"{argv[0]} cannot be started: {error}") from error
    finally:
        for copy in copies.values():
            os.close(copy)
    return ProcessMark(pid, _started_ticks(pid) or 0)


def is_alive(mark: ProcessMark) -> bool:
    """Whether that very process still runs; a later process with its id is another one."""
    with contextlib.suppress(ChildProcessError):
        os.waitpid(mark.pid, os.WNOHANG)
    return _started_ticks(mark.pid) == mark.started_ticks


def wait_gone(mark: ProcessMark, timeout_s: float) -> bool:
    """Whether the process has ended within the time."""
    deadline = time.monotonic() + timeout_s
    while is_alive(mark):
        if time.monotonic() > deadline:
            return False
        time.sleep(_POLL_S)
    return True


def kill(mark: ProcessMark) -> None:
    """Ends that very process, never a later one with its id."""
    try:
        handle = os.pidfd_open(mark.pid)
    except ProcessLookupError:
        return
    try:
        # The handle names one process for good, so the check holds when the signal is sent.
        if is_alive(mark):
            signal.pidfd_send_signal(handle, signal.SIGKILL)
    except ProcessLookupError:
        return
    finally:
        os.close(handle)


def _started_ticks(pid: int) -> int | None:
    """Field 22 of /proc/PID/stat, or None when no such process runs (a zombie does not)."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
            # The second field, the name in brackets, may hold spaces.
            fields = file.read().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] == "Z" else int(fields[19])
