"""`coadapt` as a user types it, with a run directory and a working directory of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.support.paths import REPOSITORY

Cli = Callable[..., subprocess.CompletedProcess[str]]


@contextmanager
def command_line(
    *always: str, timeout_s: float, run_dir: str = "", **settings: str
) -> Iterator[Cli]:
    """Runs commands with the options `always` behind them and these settings in the environment,
    this process's own too; `run_dir` is below the directory, which is the current one."""
    # Short, as the paths of Unix sockets have to be.
    with (
        tempfile.TemporaryDirectory(prefix="ca-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", f"{directory}/{run_dir}".rstrip("/"))
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        for name, value in settings.items():
            patch.setenv(name, value)

        def run(*arguments: str) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [sys.executable, "-m", "coadapt.main", *arguments, *always],
                cwd=directory,
                capture_output=True,
                text=True,
                timeout=timeout_s,
                check=False,
            )

        yield run


def answering(typed: Cli) -> Callable[..., Any]:
    """The same for commands that have to succeed: gives what they print, with `--json` the object
    that it is."""

    def run(*arguments: str) -> Any:
        done = typed(*arguments)
        assert done.returncode == 0, f"{arguments} exits {done.returncode}: {done.stderr}"
        return json.loads(done.stdout) if "--json" in arguments else done.stdout

    return run
