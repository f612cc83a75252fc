"""Namespaces of a run's own: nothing that it does reaches the machine, and nothing of it is left.

Inside, the swarm's ports on 127.0.0.1 are nobody else's, small file systems can be mounted, and
every process ends with the first one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence

from deploy.netns import launch
from deploy.netns.network import run
from research.benchmarks.ending import signals_raise
from swarm.errors import DeployError

MARK = "CHAOS_INSIDE"


def is_inside() -> bool:
    """Whether this process was started by `run_inside`."""
    return MARK in os.environ


def run_inside(arguments: Sequence[str]) -> int:
    """The exit status of `python -m research.chaos` in namespaces of its own.

    Raises DeployError where they cannot be made.
    """
    if (why := launch.why_not()) is not None:
        raise DeployError(why)
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    command = [
        *("unshare", *user, "--net", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"),
        *(sys.executable, "-m", "research.chaos", *arguments),
    ]
    with signals_raise():
        process = subprocess.Popen(command, env={**os.environ, MARK: "1"})
        try:
            return process.wait()
        finally:
            # It takes its child with it, and that everything that is in there.
            process.kill()
            process.wait()


def prepare() -> None:
    """To be called first inside. Raises DeployError where a program is missing."""
    for program in ("ip", "mount", "nsenter", "tc"):
        if shutil.which(program) is None:
            raise DeployError(f"the program `{program}` is missing; install iproute2, util-linux")
    run("ip", "link", "set", "lo", "up")
