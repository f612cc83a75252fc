"""`python -m research.benchmarks NAME...`: runs benchmarks one after another, each as a process.

One that fails does not hide the others: all are run, then those that failed are told, and the exit
status is 1. Whatever a benchmark leaves behind is ended before the next one begins. SIGTERM and
SIGINT end the benchmark under way, which takes its swarm down, and then this process. Writes
build/bench/run.json: how long each one took.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from typing import Any

from research.benchmarks.ending import adopt, end_adopted, signals_raise
from research.benchmarks.report import write_report

LIMIT_S = 900.0
"""Longer than the longest: one that hangs does not stop the others."""
CLEAR_UP_S = 60.0
"""Taking a swarm down takes up to 15 s, on a busy machine more."""


def run(name: str) -> dict[str, Any]:
    """Runs one benchmark to its end; how long it took, its exit status and what it left."""
    print(f"bench {name}", file=sys.stderr, flush=True)
    begun = time.monotonic()
    process = subprocess.Popen([sys.executable, "-m", f"research.benchmarks.{name}"])
    try:
        status = process.wait(LIMIT_S)
    except subprocess.TimeoutExpired:
        print(f"bench {name}: ended after {LIMIT_S:.0f} s", file=sys.stderr)
        status = end(process)
    except BaseException:
        end(process)
        raise
    finally:
        left = end_adopted()
    for command in left:
        print(f"bench {name}: left behind and ended: {command}", file=sys.stderr)
    seconds = round(time.monotonic() - begun, 1)
    return {"name": name, "seconds": seconds, "status": status, "left": left}


def end(process: subprocess.Popen[bytes]) -> int:
    """Has a benchmark clear up and end; its exit status."""
    process.terminate()
    try:
        return process.wait(CLEAR_UP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def main() -> int:
    """Runs the benchmarks that are named."""
    parser = argparse.ArgumentParser(prog="python -m research.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="+", metavar="NAME", help="a module of benchmarks/")
    names = parser.parse_args().names
    adopt()
    with signals_raise():
        rows = [run(name) for name in names]
    failed = [row["name"] for row in rows if row["status"]]
    seconds = sum(row["seconds"] for row in rows)
    write_report("run", {"seconds": round(seconds), "failed": failed, "rows": rows}, {})
    for row in rows:
        word = f"failed ({row['status']})" if row["status"] else ""
        print(f"bench {row['name']:<12} {row['seconds']:7.1f} s {word}".rstrip(), file=sys.stderr)
    print(f"bench: {seconds / 60:.0f} minutes", file=sys.stderr)
    if failed:
        print(f"bench: failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
