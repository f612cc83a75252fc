"""How much of a configured rate a fusion transfer gets, counted in bytes that arrive.

TCP streams with fusion's mark, one on each link, all at once, first towards the robots and then
from them, in network namespaces and between containers; the first two seconds are left out. 100 %
cannot be reached: rates are counted with headers, which are 4.4 % of full frames.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from typing import Any

from deploy.runtimes.docker import DockerRuntime
from network_controller import ladder
from network_controller.model import DIRECTIONS, Link
from research.benchmarks.report import write_report
from research.benchmarks.stage import Stage, docker_stage, inside, netns_stage
from swarm.traffic import TrafficClass

RATES_BPS = (1_000_000, 5_000_000, 20_000_000, 55_000_000, 100_000_000)
SECONDS, SLOW_SECONDS = 10, 20
"""A slow link carries few segments a second, and TCP hands them on in bursts."""
SLOW_BPS = 1_000_000
SKIPPED = 2
HOSTS = 2 * len(RATES_BPS)


def rows(stage: Stage, runtime: str) -> Iterator[dict[str, Any]]:
    """One row a rate and direction."""
    for direction in DIRECTIONS:
        flows = []
        for number, rate_bps in enumerate(RATES_BPS):
            shaped, peer = f"R{2 * number + 1}", f"R{2 * number + 2}"
            stage.driver.apply(Link(shaped, direction), ladder.shape(rate_bps, 0))
            source, target = (peer, shaped) if direction == "down" else (shaped, peer)
            seconds = SLOW_SECONDS if rate_bps <= SLOW_BPS else SECONDS
            flows.append(stage.flow(source, target, seconds, tos=TrafficClass.FUSION.tos))
        for number, (rate_bps, flow) in enumerate(zip(RATES_BPS, flows, strict=True)):
            counts = flow.counts()
            stage.driver.clear(Link(f"R{2 * number + 1}", direction))
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
        with netns_stage(HOSTS) as stage:
            print(json.dumps(list(rows(stage, "netns"))))
        return 0
    found: list[dict[str, Any]] = inside("research.benchmarks.shaping", "--inside")
    why_not = DockerRuntime().available()
    if why_not is None:
        with docker_stage(HOSTS) as stage:
            found += rows(stage, "docker")
    samples = {"bytes_by_second": [row.pop("bytes_by_second") for row in found]}
    figures = {"rows": found, "docker_missing": why_not}
    ratios = [row["goodput_ratio"] for row in found]
    print(f"shaping: {len(found)} rows, goodput {min(ratios):.3f} to {max(ratios):.3f} of the rate")
    write_report("shaping", figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
