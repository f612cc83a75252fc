"""Ports for what tests start: two processes that look for some at once get different ones."""

from __future__ import annotations

import subprocess
import sys

COMMAND = """
import itertools, sys
from tests.support import free_ports
free_ports._places = itertools.count(0)
print(*[free_ports.free_port() for _ in range(40)], flush=True)
sys.stdin.read()
"""


def test_no_port_is_given_to_two_processes() -> None:
    command = [sys.executable, "-c", COMMAND]
    pipe = subprocess.PIPE
    one, other = (subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for _ in range(2))
    with one, other:
        assert one.stdout is not None
        assert other.stdout is not None
        ports = [*one.stdout.readline().split(), *other.stdout.readline().split()]
    assert len(set(ports)) == len(ports) == 80
