"""How much of a configured rate a fusion transfer gets, counted in bytes that arrive.

One TCP stream with fusion's mark, in both directions of one link, in network namespaces and between
containers; the first two seconds are left out. 100 % cannot be reached: rates are counted with
headers, which are 4.4 % of full frames.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from typing import Any

from benchmarks.report import write_report
from benchmarks.stage import Stage, docker_stage, inside, netns_stage
from deploy.runtimes.docker import DockerRuntime
from network_controller import ladder
from network_controller.model import DIRECTIONS, Link
from swarm.traffic import TrafficClass

RATES_BPS = (1_000_000, 5_000_000, 20_000_000, 55_000_000, 100_000_000)
SECONDS, SLOW_SECONDS = 10, 30
"""A slow link carries few segments a second, and TCP hands them on in bursts."""
SLOW_BPS = 1_000_000
SKIPPED = 2


def rows(stage: Stage, runtime: str) -> Iterator[dict[str, Any]]:
    """One row a rate and direction."""
    for direction in DIRECTIONS:
        source, target = ("R2", "R1") if direction == "down" else ("R1", "R2")
        for rate_bps in RATES_BPS:
            link = Link("R1", direction)
            stage.driver.apply(link, ladder.shape(rate_bps, 0))
            seconds = SLOW_SECONDS if rate_bps <= SLOW_BPS else SECONDS
            counts = stage.flow(source, target, seconds, tos=TrafficClass.FUSION.tos).counts()
            stage.driver.clear(link)
            whole = counts["bytes"][SKIPPED:]
            yield {
                "rate_bps": rate_bps,
                "direction": direction,
                "runtime": runtime,
                "goodput_ratio": round(8.0 * sum(whole) / len(whole) / rate_bps, 4),
                "bytes_by_second": counts["bytes"],
            }


def main() -> int:
    """Measures both runtimes, Docker where an engine answers, and writes shaping.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    if parser.parse_args().inside:
        with netns_stage(2) as stage:
            print(json.dumps(list(rows(stage, "netns"))))
        return 0
    found: list[dict[str, Any]] = inside("benchmarks.shaping", "--inside")
    why_not = DockerRuntime().available()
    if why_not is None:
        with docker_stage(2) as stage:
            found += rows(stage, "docker")
    samples = {"bytes_by_second": [row.pop("bytes_by_second") for row in found]}
    figures = {"rows": found, "docker_missing": why_not}
    ratios = [row["goodput_ratio"] for row in found]
    print(f"shaping: {len(found)} rows, goodput {min(ratios):.3f} to {max(ratios):.3f} of the rate")
    write_report("shaping", figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
