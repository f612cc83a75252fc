"""Processes that a benchmark starts, and the ports they listen on."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from deploy.ports import LOCALHOST
from research.benchmarks.ending import signals_raise

WAIT_S = 30.0


@contextmanager
def process(module: str, *words: str, **settings: str) -> Iterator[subprocess.Popen[str]]:
    """`python -m module`, with one numerical thread; told to end at the context's end."""
    with signals_raise():
        started = subprocess.Popen(
            [sys.executable, "-m", module, *words],
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **settings},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            yield started
        finally:
            started.terminate()
            started.communicate(timeout=WAIT_S)


def free_port() -> int:
    """A port that nothing listens on; others than those given before, as a rule."""
    with socket.socket() as probe:
        probe.bind((LOCALHOST, 0))
        return int(probe.getsockname()[1])


def free_ports(count: int) -> int:
    """The first of `count` consecutive ports that nothing listens on, as a router needs them."""
    for first in range(20_000, 32_000, count):
        with ExitStack() as stack:
            try:
                for port in range(first, first + count):
                    stack.enter_context(socket.create_server((LOCALHOST, port)))
            except OSError:
                continue
            return first
    raise RuntimeError(f"no {count} consecutive free ports from 20000 to 32000")


def await_port(port: int) -> None:
    """Until something answers there. Raises TimeoutError."""
    deadline = time.monotonic() + WAIT_S
    while True:
        with (
            contextlib.suppress(OSError),
            socket.create_connection((LOCALHOST, port), timeout=1.0),
        ):
            return
        if time.monotonic() > deadline:
            raise TimeoutError(f"nothing answers on port {port} after {WAIT_S:.0f} s")
        time.sleep(0.1)
