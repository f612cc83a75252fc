"""Frames, clocks and signals of a process."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

from hypothesis import given
from hypothesis import strategies as st

from swarm.process import Clock, capture_ns, frame_now

EPOCH = 1_800_000_000_000_000_000


@given(st.integers(0, 10**10), st.sampled_from([1.0, 5.0, 10.0, 12.5, 29.97]))
def test_a_frame_is_newest_from_its_capture_to_the_next(frame: int, rate_hz: float) -> None:
    assert frame_now(EPOCH, rate_hz, capture_ns(EPOCH, rate_hz, frame)) == frame
    assert frame_now(EPOCH, rate_hz, capture_ns(EPOCH, rate_hz, frame + 1) - 1) == frame


def test_before_the_epoch_the_frame_is_the_first() -> None:
    assert frame_now(EPOCH, 10.0, EPOCH - 1) == 0


def test_a_clock_that_is_off_is_off_by_its_offset() -> None:
    ahead = Clock(2.5)
    assert ahead.offset_ns == 2_500_000_000
    before = time.time_ns()
    assert before <= ahead.now_ns() - ahead.offset_ns <= time.time_ns()


def test_a_signal_sets_the_event_and_leave_ends_also_with_a_thread_that_hangs() -> None:
    code = (
        "import threading, sys\n"
        "from swarm.process import leave, stop_on_signals\n"
        "stop = stop_on_signals()\n"
        "threading.Thread(target=threading.Event().wait).start()\n"
        "print('ready', flush=True)\n"
        "stop.wait()\n"
        "print('stopped')\n"
        "leave(0)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        child.send_signal(signal.SIGTERM)
        assert child.stdout.read() == "stopped\n"
        assert child.wait(20) == 0
