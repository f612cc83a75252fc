"""What the network controller costs: its processor time as a share of one core.

The controller process itself in network namespaces with the links of 6 and of 50 robots, a real
router, and an ego's demand every second. Only the ego's cell is shaped, as in a running swarm; or
it follows a series of rates second by second; or every link is shaped in both directions. The three
run at the same time, each in namespaces of its own: together they take a part of one core, and what
is counted is processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from research.benchmarks.report import write_report
from research.benchmarks.stage import inside_together, netns_stage
from swarm import keyspace
from swarm.messages import NetDemand, ShapeReply, ShapeRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

ROUTER_PORT = 17610
SECONDS = 20
RATE_BPS = 20_000_000
SWARM = "bench"
CASES = ("cell", "follows", "all")


def share(robots: int, what: str) -> float:
    """Share of a core over `SECONDS`, once everything is shaped."""
    with netns_stage(robots) as stage:
        router = stage.start(
            "infra", "swarm.router", "--host", "10.77.0.1", "--port", str(ROUTER_PORT)
        )
        environment = {
            "COADAPT_SWARM": SWARM,
            "COADAPT_ROUTER": f"tcp/10.77.0.1:{ROUTER_PORT}",
            "COADAPT_METRICS_PORT": "0",
            "COADAPT_QOD_PORT": "0",
            "COADAPT_EGO": "R1",
            "COADAPT_LOG_LEVEL": "error",
        }
        os.environ.update(environment)
        controller = stage.start("infra", "network_controller")
        try:
            with Session(environment["COADAPT_ROUTER"], SWARM, timeout_s=20) as session:
                _shape(session, _wishes(what, list(stage.driver.robots())))
                begun, used = time.monotonic(), cpu_s(controller.pid)
                while time.monotonic() < begun + SECONDS:
                    session.put(keyspace.net_demand(SWARM), demand())
                    time.sleep(1.0)
                return (cpu_s(controller.pid) - used) / (time.monotonic() - begun)
        finally:
            for process in (controller, router):
                process.terminate()
                process.wait()


def _wishes(what: str, robots: list[str]) -> list[ShapeRequest]:
    """What is asked for in one of CASES."""
    if what == "follows":
        rates = tuple(RATE_BPS + 100_000 * (i % 7) for i in range(60))
        return [ShapeRequest(profile="trace", rates_bps=rates)]
    if what == "cell":
        return [ShapeRequest(profile="rate", rate_bps=RATE_BPS)]
    return [
        ShapeRequest(profile="rate", rate_bps=RATE_BPS, robot=robot, direction="both")
        for robot in robots
    ]


def _shape(session: Session, wishes: list[ShapeRequest]) -> None:
    """Has the controller carry out wishes, once it is there."""
    key = keyspace.net_shape(SWARM)
    deadline = time.monotonic() + 30
    for wish in wishes:
        while True:
            future = session.ask(key, wish, ShapeReply, timeout_s=10, traffic=TrafficClass.CONTROL)
            if future.exception() is None:
                break
            if time.monotonic() > deadline:
                future.result()
            time.sleep(0.2)


def demand() -> NetDemand:
    """What an ego says every second."""
    return NetDemand(
        ego="R1",
        cycle=1,
        sent_ns=time.time_ns(),
        needed_bytes_s=100_000,
        possible=True,
        reachable=True,
        unreachable_s=0.0,
        quality=0.9,
        q_min=0.7,
        capacity_bps=RATE_BPS,
    )


def cpu_s(pid: int) -> float:
    """Processor time of a process and of the children that it has waited for."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / float(os.sysconf("SC_CLK_TCK"))


def main() -> int:
    """Measures and writes controller.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inside", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--what", choices=CASES, default="cell", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.inside:
        print(json.dumps(share(args.inside, args.what)))
        return 0
    found: dict[tuple[int, str], Any] = {}
    for robots in (6, 50):
        jobs = [("--inside", str(robots), "--what", what) for what in CASES]
        found |= zip(
            ((robots, what) for what in CASES),
            inside_together("research.benchmarks.controller", jobs),
            strict=True,
        )
    figures = {
        "cpu_share_6": round(found[6, "cell"], 4),
        "cpu_share_50": round(found[50, "cell"], 4),
        "cpu_share_6_follows": round(found[6, "follows"], 4),
        "cpu_share_50_follows": round(found[50, "follows"], 4),
        "cpu_share_6_all_links": round(found[6, "all"], 4),
        "cpu_share_50_all_links": round(found[50, "all"], 4),
        "seconds": SECONDS,
    }
    print(
        f"controller: {100 * figures['cpu_share_6']:.2f} % of a core with 6 robots, "
        f"{100 * figures['cpu_share_50']:.2f} % with 50"
    )
    write_report("controller", figures, {})
    return 0


if __name__ == "__main__":
    sys.exit(main())
