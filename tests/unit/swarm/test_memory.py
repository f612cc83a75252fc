"""Freed memory stays with the process, and the collector keeps off a control cycle."""

from __future__ import annotations

import subprocess
import sys

import pytest

FRAMES = """
import resource, threading
import numpy as np
{before}
def frames():
    for _ in range(50):
        pieces = [np.ones(2 << 20, np.uint8) for _ in range(14)]
def faults(work):
    frames()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    work()
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
def in_thread():
    thread = threading.Thread(target=frames)
    thread.start()
    thread.join()
print(faults({work}))
"""
PAGES = 50 * 14 * (2 << 20) // 4096
KEEP = "from swarm.memory import keep_freed_memory; keep_freed_memory()"


def faults(before: str, work: str) -> int:
    code = FRAMES.format(before=before, work=work)
    return int(subprocess.check_output([sys.executable, "-c", code], text=True))


@pytest.mark.parametrize("work", ["frames", "in_thread"])
def test_pages_are_asked_for_once(work: str) -> None:
    assert faults(KEEP, work) < PAGES / 20


def test_without_it_pages_are_asked_for_again_and_again() -> None:
    assert faults("", "frames") > PAGES / 5


def test_a_cycles_messages_start_no_collection() -> None:
    code = """
import gc
from swarm.memory import collect_rarely
{before}
begun = sum(stat["collections"] for stat in gc.get_stats())
kept = [[number] for number in range(40_000)]
print(sum(stat["collections"] for stat in gc.get_stats()) - begun)
rings = []
for _ in range(200_000):
    ring = []
    ring.append(ring)
print(gc.get_stats()[0]["collected"] > 100_000)
"""
    told = [
        subprocess.check_output([sys.executable, "-c", code.format(before=before)], text=True)
        for before in ("collect_rarely()", "")
    ]
    assert told[0].split() == ["0", "True"]
    assert int(told[1].split()[0]) > 10
