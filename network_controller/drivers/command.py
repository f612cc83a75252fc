"""Running `tc` and `ip`: no shell, a time limit, and their own words when they fail."""

from __future__ import annotations

import re
import subprocess

from swarm.errors import NetworkError

TIMEOUT_S = 20.0
_STOPPED = re.compile(r"Command failed \S*:(\d+)")


def run(*argv: str, text: str = "") -> str:
    """The output of a command. Raises NetworkError with its words when it fails."""
    done = attempt(*argv, text=text)
    if done.returncode != 0:
        raise NetworkError(f"{' '.join(argv)} failed: {words(done, text)}")
    return done.stdout


def attempt(*argv: str, text: str = "") -> subprocess.CompletedProcess[str]:
    """Runs a command that may fail. Raises NetworkError when it cannot be run at all."""
    try:
        return subprocess.run(
            argv, input=text, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )
    except FileNotFoundError as error:
        raise NetworkError(
            f"the program {argv[0]!r} is missing; install the package iproute2"
        ) from error
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NetworkError(f"{' '.join(argv)} cannot be run: {error}") from error


def words(done: subprocess.CompletedProcess[str], text: str = "") -> str:
    """Why a command failed; of a batch also the line that it stopped at."""
    told = " ".join((done.stderr or done.stdout).split()) or f"exit status {done.returncode}"
    stopped = _STOPPED.search(told)
    lines = text.splitlines()
    if stopped and 0 < int(stopped[1]) <= len(lines):
        return f"{told[: stopped.start()].strip()} (at: {lines[int(stopped[1]) - 1]})"
    return told
