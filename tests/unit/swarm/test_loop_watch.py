"""A process whose loop no longer turns ends itself; one that only rests does not."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

from swarm.loop_watch import HUNG

WAIT_S = 60
STARVED = 1
"""Python's own timeout came first: the watching thread did not run, either."""

BEGIN = """
import asyncio, ctypes, sys, threading, time
from swarm.log import make_logger
from swarm.loop_watch import LoopWatch, keep_turning

watch = LoopWatch(make_logger("test"), hang_s=1.0)
"""


def ended(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BEGIN + code], capture_output=True, text=True, timeout=WAIT_S
    )


def test_a_loop_that_hangs_ends_the_process_which_says_where() -> None:
    done = ended("""
def in_the_way(): threading.Event().wait()
turned = watch.loop("cycle")
turned()
in_the_way()
""")
    assert done.returncode == HUNG
    assert '"event": "hung"' in done.stderr
    assert '"loop": "cycle"' in done.stderr
    assert "in in_the_way" in done.stderr


def test_so_does_one_that_keeps_the_lock_of_python() -> None:
    done = ended("""
turned = watch.loop("cycle")
turned()
ctypes.PyDLL(None).sleep(1000)
""")
    assert done.returncode not in (0, -9)
    assert "Timeout" in done.stderr


def test_so_does_one_whose_last_words_nobody_takes() -> None:
    """As when the disk of the log blocks."""
    code = (
        BEGIN
        + """
turned = watch.loop("cycle")
turned()
sys.stderr.write("x" * 10_000_000)
"""
    )
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE) as process:
        assert process.wait(WAIT_S) in (HUNG, STARVED)


def test_so_does_one_that_did_not_run_while_nobody_took_its_words() -> None:
    """The lock of Python must not wait for a traceback that nobody reads."""
    code = (
        BEGIN
        + """
turned = watch.loop("cycle")
turned()
print("on", flush=True)
sys.stderr.write("x" * 10_000_000)
"""
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", code], stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGSTOP)
        time.sleep(1.5)
        process.send_signal(signal.SIGCONT)
        assert process.wait(WAIT_S) in (HUNG, STARVED)


def test_so_does_an_event_loop_that_is_blocked() -> None:
    done = ended("""
async def main():
    turning = asyncio.create_task(keep_turning(watch.loop("gateway")))
    await asyncio.sleep(0)
    threading.Event().wait()
asyncio.run(main())
""")
    assert done.returncode == HUNG
    assert '"loop": "gateway"' in done.stderr


def test_a_loop_that_has_not_begun_or_may_rest_is_let_be() -> None:
    done = ended("""
watch.loop("not begun")
turned = watch.loop("at rest", 1000.0)
turned()
time.sleep(3.0)
print("well")
""")
    assert (done.returncode, done.stdout) == (0, "well\n")
