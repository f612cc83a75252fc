"""Leaving nothing behind, however a benchmark ends.

A signal that asks a process to end raises here, so that every open context is closed: a swarm is
taken down, namespaces and processes go. `adopt` and `end_adopted` are for what is left of a
benchmark that had no chance to do so.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
PR_SET_CHILD_SUBREAPER = 36
"""<linux/prctl.h>"""
POLL_S = 0.05


@contextmanager
def signals_raise() -> Iterator[None]:
    """Meanwhile SIGTERM, SIGINT and SIGHUP raise SystemExit(128 + number) on the main thread.

    Only the first one does: those that follow must not stop the clearing up. Does nothing on
    another thread, which no signal reaches.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ending = False

    def end(number: int, _: FrameType | None) -> None:
        nonlocal ending
        ending = True
        for each in SIGNALS:
            signal.signal(each, signal.SIG_IGN)
        raise SystemExit(128 + number)

    before = {number: signal.signal(number, end) for number in SIGNALS}
    try:
        yield
    finally:
        if not ending:
            for number, handler in before.items():
                signal.signal(number, handler)


def adopt() -> None:
    """From now on orphans among this process's descendants become its children, also those that
    have a session of their own, as a swarm's supervisor does. Raises OSError."""
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_CHILD_SUBREAPER)")


def end_adopted(patience_s: float = 10.0) -> list[str]:
    """Ends all children of this process, and those that they leave; their command lines.

    SIGTERM first, SIGKILL for what is there after `patience_s`. Call it only while this process has
    no children that it wants to keep.
    """
    ended: dict[int, str] = {}
    kill_at = time.monotonic() + patience_s
    while children := _children():
        late = time.monotonic() > kill_at
        for pid in children:
            if late or pid not in ended:
                ended[pid] = _command(pid)
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL if late else signal.SIGTERM)
        time.sleep(POLL_S)
    return list(ended.values())


def _children() -> list[int]:
    """Process ids of the children that run; those that have ended are reaped."""
    running = []
    for task in Path("/proc/self/task").iterdir():
        for word in (task / "children").read_text().split():
            with suppress(ChildProcessError):
                if os.waitpid(int(word), os.WNOHANG) == (0, 0):
                    running.append(int(word))
    return running


def _command(pid: int) -> str:
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        return b" ".join(words).decode(errors="replace").strip()
    return f"process {pid}"
