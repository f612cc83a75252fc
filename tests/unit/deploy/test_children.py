"""A supervisor's processes are started again, whatever keeps them from running."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

WAIT_S = 60

SUPERVISOR = """
import asyncio, json, os, signal, sys
from pathlib import Path

from deploy.netns import children
from deploy.netns.children import Children
from deploy.roster import INFRA, Service
from swarm.log import make_logger

children.WATCH_S, children.HELD_S, children.FIRST_DELAY_S = 0.05, 0.2, 0.05
folder = Path(sys.argv[1])
program = folder / "program"
service = Service("p", "router", INFRA, (str(program),))


async def until(condition):
    while not condition():
        await asyncio.sleep(0.02)


async def main():
    members = Children((service,), folder, make_logger("test"))
    members.start()
    seen = {}
    await SCENE(members, seen)
    await members.stop()
    print(json.dumps(seen))


def status(members):
    return members.status()[0]
"""

STOPPED = """
async def scene(members, seen):
    members.kill("p", signal.SIGSTOP)
    await until(lambda: status(members).restarts == 1 and status(members).state == "running")
    seen["detail"] = status(members).detail
"""

GONE = """
async def scene(members, seen):
    program.rename(folder / "away")
    members.kill("p", signal.SIGKILL)
    await until(lambda: "cannot be started again" in status(members).detail)
    seen["state"] = status(members).state
    (folder / "away").rename(program)
    await until(lambda: status(members).state == "running")
"""

PAUSED = """
async def scene(members, seen):
    children.HELD_S = 1000.0
    members.kill("p", signal.SIGSTOP)
    await asyncio.sleep(0.3)
    members.kill("p", signal.SIGCONT)
    await asyncio.sleep(0.3)
    seen["restarts"] = status(members).restarts
"""

FULL = """
from functools import partial

from deploy.netns.log_files import rotate_logs

children.rotate_logs = partial(rotate_logs, log_bytes=1000)


async def scene(members, seen):
    (folder / "p.log").write_text("x" * 1000)
    await until(lambda: (folder / "p.log.1").exists())
    await until(lambda: (folder / "p.log").stat().st_size == 0)
    seen["restarts"] = status(members).restarts
"""


def supervised(folder: Path, scene: str) -> Any:
    """What a scene has seen of one process under a supervisor: in a process of its own, as a
    supervisor reaps every process that it finds."""
    program = folder / "program"
    program.write_text("#!/bin/sh\nexec sleep 1000\n")
    program.chmod(0o755)
    code = SUPERVISOR.replace("SCENE", "scene") + scene + "\nasyncio.run(main())\n"
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], capture_output=True, text=True, timeout=WAIT_S
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_process_that_stays_stopped_is_started_again(tmp_path: Path) -> None:
    assert supervised(tmp_path, STOPPED) == {"detail": "last ended with signal 9"}


def test_a_process_that_was_let_go_on_in_time_is_left_alone(tmp_path: Path) -> None:
    assert supervised(tmp_path, PAUSED) == {"restarts": 0}


def test_a_start_that_failed_is_tried_again(tmp_path: Path) -> None:
    assert supervised(tmp_path, GONE) == {"state": "restarting"}


def test_a_full_log_makes_room_while_its_process_runs(tmp_path: Path) -> None:
    assert supervised(tmp_path, FULL) == {"restarts": 0}
