"""One input once more, alone in a process of its own and without instruments."""

from __future__ import annotations

import argparse
import json
import resource
import signal
import subprocess
import sys
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from research.fuzz.limits import HANG_CPU_S, JUMP_MB, forget_peak, held_mb, peak_mb, scratch
from research.fuzz.target import Target, load

Kind = Literal["crash", "hang", "jump"]
MOST_CPU_S = 5
"""Of a trial; then the kernel ends it."""
_GIVE_UP_S = 600.0
"""By the clock, whatever else the machine does."""
_ADDRESS_SPACE = 3 << 30
"""What an input may ask for beyond what the process has, bytes."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What an input does that it must not."""

    kind: Kind
    what: str


def fault(target: Target, data: bytes) -> str:
    """What an input raises that the target does not name, as one line; empty where it is well."""
    try:
        target.take(data)
    except target.errors:
        return ""
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(frame.filename).name}:{frame.lineno}"
        return f"{type(error).__name__} at {where}: {error}"[:500]
    return ""


def attempt(target: Target, data: bytes) -> Finding | None:
    """Takes one input in this process.

    A sound input goes first, so that modules and tables that are loaded only then count for no one.
    """
    for warm in (b"", data[:1]):
        fault(target, warm)
    forget_peak()
    before_mb, before_s = held_mb(), time.process_time()
    raised = fault(target, data)
    cpu_s, grown_mb = time.process_time() - before_s, peak_mb() - before_mb
    if raised:
        return Finding("crash", raised)
    if cpu_s > HANG_CPU_S:
        return Finding("hang", f"it took {cpu_s:.1f} s of the processor")
    if grown_mb > JUMP_MB:
        return Finding("jump", f"it took {grown_mb:.0f} MB")
    return None


def try_out(place: str, path: Path) -> Finding | None:
    """What an input does to a target, in a process of its own; None when it may."""
    with scratch() as settings:
        done = subprocess.run(
            [sys.executable, "-m", "research.fuzz.trial", place, str(path)],
            env=settings,
            capture_output=True,
            text=True,
            timeout=_GIVE_UP_S,
            check=False,
        )
    if done.returncode == 0:
        found = json.loads(done.stdout.splitlines()[-1])
        return None if found is None else Finding(found["kind"], found["what"])
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return Finding("hang", f"it did not end within {MOST_CPU_S} s of the processor")
    return Finding("crash", f"the process ended ({done.returncode}): {done.stderr[-500:].strip()}")


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("place", help="the target: module:NAME")
    parser.add_argument("input", type=Path)
    args = parser.parse_args()
    target = load(args.place)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + _ADDRESS_SPACE,) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S + 2))
    found = attempt(target, args.input.read_bytes())
    print(json.dumps(None if found is None else {"kind": found.kind, "what": found.what}))


if __name__ == "__main__":
    _main()
