"""Progress of a command that takes a while, for the person who waits."""

from __future__ import annotations

import sys


def say(line: str) -> None:
    """One line on standard error: standard output belongs to the command's result."""
    print(line, file=sys.stderr, flush=True)
