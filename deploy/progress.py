"""What is said to the person at the command line: progress, and what to type next."""

from __future__ import annotations

import sys

from swarm.defaults import SWARM
from worlds.sample import is_checkout

_SUBCOMMANDS = {"shape": "net shape", "congest": "net congest", "net": "net show"}
"""Targets of the Makefile that are called otherwise on the command line."""


def say(line: str) -> None:
    """One line on standard error: standard output belongs to the command's result."""
    print(line, file=sys.stderr, flush=True)


def typed(command: str, swarm: str = SWARM, **options: object) -> str:
    """A command with options, as it is typed: `make shape SWARM=qa RATE=5mbit` in a checkout, and
    from an installed wheel `coadapt net shape --swarm qa --rate 5mbit`. `command` is a target of
    the Makefile. The swarm that is meant where none is named goes without saying."""
    options = ({"swarm": swarm} if swarm != SWARM else {}) | options
    if is_checkout():
        return " ".join(["make", command, *(f"{k.upper()}={v}" for k, v in options.items())])
    command = _SUBCOMMANDS.get(command, command)
    return " ".join(["coadapt", command, *(f"--{k} {v}" for k, v in options.items())])
