"""What is said to the person at the command line: progress, and what to type next."""

from __future__ import annotations

import sys

from worlds.sample import is_checkout


def say(line: str) -> None:
    """One line on standard error: standard output belongs to the command's result."""
    print(line, file=sys.stderr, flush=True)


def typed(command: str, **options: object) -> str:
    """A command with options, as it is typed: `make up WORLD=road` in a checkout, and from an
    installed wheel `coadapt up --world road`."""
    if is_checkout():
        return " ".join(["make", command, *(f"{k.upper()}={v}" for k, v in options.items())])
    return " ".join(["coadapt", command, *(f"--{k} {v}" for k, v in options.items())])
