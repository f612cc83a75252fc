"""A real ego that hangs is started again by its supervisor, and decides again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from swarm.loop_watch import HUNG

WAIT_S = 240
"""The ego starts twice, on a machine that may be busy."""

EGO = """
import sys, threading
from pathlib import Path

from ego_agent import __main__ as process
from ego_agent.agent import EgoAgent
from swarm import loop_watch

loop_watch.HANG_S = 10.0
stuck = Path(sys.argv[1])
complete = EgoAgent._complete


def complete_or_hang(agent, running):
    complete(agent, running)
    if not stuck.exists():
        stuck.touch()
        threading.Event().wait()


EgoAgent._complete = complete_or_hang
sys.exit(process.main())
"""

SUPERVISOR = """
import asyncio, sys
from pathlib import Path

from deploy.netns.children import Children
from deploy.roster import INFRA, Service
from swarm.log import make_logger

folder = Path(sys.argv[1])
ego = Service(
    "ego", "ego", INFRA, (sys.executable, str(folder / "ego.py"), str(folder / "stuck")),
    env={"COADAPT_METRICS_PORT": "0", "COADAPT_PERIOD_S": "0.2", "COADAPT_WORLD_RINGS": "16",
         "COADAPT_JOURNAL": str(folder / "journal"), "COADAPT_WORLD_ROBOTS": "2"},
)


async def main():
    members = Children((ego,), folder, make_logger("test"))
    members.start()
    while members.status()[0].restarts == 0:
        await asyncio.sleep(0.1)
    print(members.status()[0].detail)
    lines = (folder / "journal").read_bytes().count(b"\\n")
    while (folder / "journal").read_bytes().count(b"\\n") <= lines:
        await asyncio.sleep(0.1)
    await members.stop()


asyncio.run(main())
"""


@pytest.mark.slow
def test_an_ego_whose_loop_hangs_is_started_again_and_decides(tmp_path: Path) -> None:
    (tmp_path / "ego.py").write_text(EGO)
    with subprocess.Popen(
        [sys.executable, "-c", SUPERVISOR, str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as supervisor:
        try:
            said, _ = supervisor.communicate(timeout=WAIT_S)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(supervisor.pid, signal.SIGKILL)
    log = (tmp_path / "ego.log").read_text()
    assert said == f"last ended with exit status {HUNG}\n", log
    assert '"loop": "cycle"' in log
    assert "in complete_or_hang" in log
