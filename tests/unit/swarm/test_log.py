"""Logs never stop a process."""

from __future__ import annotations

import json
import subprocess
import sys

LOG = (
    "from swarm.log import make_logger\n"
    "from swarm.process import leave\n"
    "log = make_logger('robot', swarm='s')\n"
    "for i in range(1000): log.info('event', number=i)\n"
    "print('done', flush=True)\n"
    "leave(0)\n"
)


def test_a_line_is_one_json_object() -> None:
    done = subprocess.run([sys.executable, "-c", LOG], capture_output=True, text=True, check=True)
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    assert len(lines) == 1000
    assert lines[7]["process"] == "robot"
    assert (lines[7]["swarm"], lines[7]["event"], lines[7]["number"]) == ("s", "event", 7)


def test_a_full_log_disk_stops_nothing() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-c", LOG], stdout=subprocess.PIPE, stderr=full)
    assert done.returncode == 0
    assert done.stdout == b"done\n"
