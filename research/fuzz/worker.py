"""Looks for inputs of one target that end wrongly: atheris makes them, guided by coverage.

It goes on after a suspicion, so that one fault does not hide the others. The library's own faults
(a crash of C, a loop without end) end it; it leaves the input beside the suspicions.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

import atheris

from research.fuzz.limits import HANG_CPU_S, JUMP_MB, forget_peak
from research.fuzz.target import Target, load, packages
from research.fuzz.values import changed

STUCK_S = 120
"""By the clock: an input that takes longer ends the worker, and is a suspicion."""
MOST_MB = 4096
_OF_A_KIND = 2
"""Inputs that are kept of each suspicion."""


class Watched:
    """A target whose suspicious inputs are written to a folder."""

    def __init__(self, target: Target, folder: Path) -> None:
        """The folder must be there."""
        self._target = target
        self._folder = folder
        self._seen: dict[str, int] = {}
        self._status = os.open("/proc/self/status", os.O_RDONLY)

    def take(self, data: bytes) -> None:
        """Takes one input."""
        before_s, before_kb = time.process_time(), self._peak_kb()
        try:
            self._target.take(data)
        except self._target.errors:
            pass
        except Exception as error:
            self._keep("crash", _place_of(error), data)
        if time.process_time() - before_s > HANG_CPU_S:
            self._keep("hang", "", data)
        if (rise := self._peak_kb() - before_kb) > 0:
            # Half of the limit: what was held before may have been higher for a moment.
            if rise > JUMP_MB * 1024 / 2:
                self._keep("jump", "", data)
            forget_peak()

    def _peak_kb(self) -> int:
        # Not `getrusage`: its peak is of whoever started this process, too.
        status = os.pread(self._status, 4096, 0)
        return int(status.partition(b"VmHWM:")[2].split(None, 1)[0])

    def _keep(self, kind: str, where: str, data: bytes) -> None:
        key = f"{kind}-{where}"
        self._seen[key] = self._seen.get(key, 0) + 1
        if self._seen[key] <= _OF_A_KIND:
            name = hashlib.sha256(data).hexdigest()[:16]
            (self._folder / f"{kind}-{name}").write_bytes(data)


def _place_of(error: Exception) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    line = trace.tb_lineno if trace is not None else 0
    return f"{type(error).__name__}:{line}"


def _mutator(json_from: int) -> Callable[[bytes, int, int], bytes]:
    """Every other time changes a value of the JSON, else some bytes."""

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        made = changed(data, json_from, random.Random(seed)) if seed % 2 else None
        if made is None or len(made) > most:
            mutated: bytes = atheris.Mutate(data, most)
            return mutated
        return made

    return mutate


def _main() -> None:
    began = time.monotonic()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("place", help="the target: module:NAME")
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--runs", type=int, default=-1, help="inputs at most")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--suspicions", type=Path, required=True, help="a folder")
    parser.add_argument("corpus", type=Path, nargs="+", help="folders; the first one grows")
    args = parser.parse_args()
    with atheris.instrument_imports(include=list(packages(args.place))):
        target = load(args.place)
    left_s = max(1, round(args.seconds - (time.monotonic() - began)))
    options = {
        **{"max_total_time": left_s, "seed": args.seed, "max_len": target.max_bytes},
        "runs": args.runs,
        **{"timeout": STUCK_S, "rss_limit_mb": MOST_MB, "print_final_stats": 1},
        "artifact_prefix": f"{args.suspicions}/native-",
    }
    words = [f"-{name}={value}" for name, value in options.items()]
    atheris.Setup(
        [sys.argv[0], *words, *map(str, args.corpus)],
        Watched(target, args.suspicions).take,
        **({} if target.json_from is None else {"custom_mutator": _mutator(target.json_from)}),
    )
    atheris.Fuzz()


if __name__ == "__main__":
    _main()
