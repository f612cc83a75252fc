"""Ports for what tests start: none is given out twice, by whatever process of this user's tests."""

from __future__ import annotations

import fcntl
import itertools
import os
import random
import socket
import tempfile
from contextlib import ExitStack
from functools import cache
from pathlib import Path

# Below those that the kernel gives to outgoing connections, which may take one at any time.
FIRST, END = 20_000, 32_000
_places = itertools.count(random.randrange(END - FIRST))


def free_port() -> int:
    """A TCP port of 127.0.0.1 that nothing listens on."""
    return free_ports(1)


def free_ports(count: int) -> int:
    """The first of `count` consecutive TCP ports of 127.0.0.1 that nothing listens on."""
    for _ in range(END - FIRST):
        ports = [FIRST + next(_places) % (END - FIRST) for _ in range(count)]
        with ExitStack() as stack:
            try:
                for port in ports:
                    _take(port)
                    taken = stack.enter_context(socket.socket())
                    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    taken.bind(("127.0.0.1", port))
                    taken.listen()
            except OSError:
                continue
        if ports[-1] - ports[0] == count - 1:
            return ports[0]
    raise AssertionError(f"no {count} consecutive free ports from {FIRST} to {END}")


def _take(port: int) -> None:
    """Keeps a port for this process: what was given out is free until somebody listens on it.
    Raises OSError where another process has taken it."""
    fcntl.lockf(_locks(), fcntl.LOCK_EX | fcntl.LOCK_NB, 1, port)


@cache
def _locks() -> int:
    """A file of which each process locks the bytes of its ports, until it ends."""
    path = Path(tempfile.gettempdir()) / f"coadapt-test-ports-{os.getuid()}"
    return os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
