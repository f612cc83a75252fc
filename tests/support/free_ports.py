"""Ports for what tests start: no port is given out twice in a run."""

from __future__ import annotations

import itertools
import random
import socket
from contextlib import ExitStack

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
                    taken = stack.enter_context(socket.socket())
                    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    taken.bind(("127.0.0.1", port))
                    taken.listen()
            except OSError:
                continue
        if ports[-1] - ports[0] == count - 1:
            return ports[0]
    raise AssertionError(f"no {count} consecutive free ports from {FIRST} to {END}")
