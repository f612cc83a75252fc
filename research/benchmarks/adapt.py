"""How soon a decision fits after the link has lost capacity.

A swarm of six robots in network namespaces with a control cycle of one second. The controller takes
the cell from 55 to 1 Mbit/s and back, several times. A decision fits when its predicted traffic is
no more than the link's rate; a cycle after that is infeasible when the bytes that it received, by
the journal, are more than the link carries in its time.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from deploy.paths import journal_path
from deploy.spec import SwarmSpec
from research.benchmarks.live import live_swarm
from research.benchmarks.report import write_report

WIDE, NARROW = "55mbit", "1mbit"
NARROW_BPS = 1_000_000
TRIALS = 3
SETTLE_S = 12.0
WATCH_S = 12.0


def shape(spec: SwarmSpec, rate: str) -> int:
    """Has the controller shape the cell; when it had done so, nanoseconds since the epoch."""
    subprocess.run(
        [
            *(sys.executable, "-m", "coadapt.main", "net", "shape", "--rate", rate),
            *("--swarm", spec.swarm, "--json"),
        ],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return time.time_ns()


def cycles(spec: SwarmSpec) -> list[dict[str, Any]]:
    """The journal's lines so far."""
    text = Path(journal_path(spec, spec.var_dir)).read_text()
    return [json.loads(line) for line in text.splitlines() if line.endswith("}")]


def trial(spec: SwarmSpec) -> dict[str, Any]:
    """One drop: cycles until a decision fits, and those after it that did not."""
    shape(spec, WIDE)
    time.sleep(SETTLE_S)
    dropped_ns = shape(spec, NARROW)
    time.sleep(WATCH_S)
    after = [line for line in cycles(spec) if line["started_ns"] > dropped_ns]
    fits = [cost_bps(line) <= NARROW_BPS for line in after]
    first = fits.index(True) if True in fits else len(fits)
    # The cycle's own line also holds answers to the frames before it.
    later = after[first + 1 :]
    return {
        "cycles_to_fit": first + 1,
        "infeasible_after": sum(received_bps(line, spec) > NARROW_BPS for line in later),
        "cycles": len(later),
        "algorithms": [line["decision"]["algorithm"] for line in after],
        "received_bps": [round(received_bps(line, spec)) for line in after],
    }


def cost_bps(line: dict[str, Any]) -> float:
    """Predicted traffic of a decision."""
    return 8.0 * float(line["decision"]["rate_hz"]) * float(line["decision"]["cost_bytes"])


def received_bps(line: dict[str, Any], spec: SwarmSpec) -> float:
    """What a cycle received."""
    total = sum(n for by_name in line["bytes"].values() for n in by_name.values())
    return float(8.0 * total / spec.period_s)


def main() -> int:
    """Measures and writes adapt.json."""
    with live_swarm("bench-adapt", {}, link_bps=None) as state:
        trials = [trial(state.spec) for _ in range(TRIALS)]
    figures = {
        "cycles_to_fit": max(t["cycles_to_fit"] for t in trials),
        "cycles_to_fit_median": statistics.median(t["cycles_to_fit"] for t in trials),
        "infeasible_cycles_after": sum(t["infeasible_after"] for t in trials),
        "cycles": sum(t["cycles"] for t in trials),
        "drops": TRIALS,
        "from": WIDE,
        "to": NARROW,
    }
    print(
        f"adapt: a decision fits after {figures['cycles_to_fit']} cycles at most; "
        f"{figures['infeasible_cycles_after']} of {figures['cycles']} cycles after it did not"
    )
    write_report("adapt", figures, {"trials": trials})
    return 0


if __name__ == "__main__":
    sys.exit(main())
