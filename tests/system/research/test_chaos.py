"""`make chaos`: a few faults on a real swarm, and none of them breaks anything."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from deploy.netns import launch

_refused = launch.why_not()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
]
KINDS = ("partition-robot", "stop-robot", "kill-console", "full-journal", "garbage")
COMMAND = (sys.executable, "-m", "research.chaos")


def test_a_short_run_breaks_nothing(tmp_path: Path) -> None:
    output = tmp_path / "chaos.json"
    done = subprocess.run(
        [
            *(*COMMAND, "--minutes", "0.45", "--faults", str(len(KINDS)), "--robots", "3"),
            *("--kinds", ",".join(KINDS), "--recovery-cycles", "12", "--output", str(output)),
        ],
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode in (0, 1), done.stderr
    found = json.loads(output.read_text())
    assert found["faults"] + len(found["unplayed"]) == len(KINDS)
    # What is judged by times is not judged here: a starved machine keeps none of them.
    assert not {one["rule"] for one in found["broken"]} & UNTIMED, done.stdout
    assert found["journal_lost"] == found["hijacked"] == 0
    assert found["cycles"] > 0


UNTIMED = {"journal without a hole", "no stranger's part", "no decision over the link"}


def test_a_kind_that_is_not_there_is_named() -> None:
    done = subprocess.run([*COMMAND, "--kinds", "flood"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "no kinds of faults: flood; allowed: kill-robot," in done.stderr
