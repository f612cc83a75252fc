"""What a site costs its ego and its router, from 10 to 1,000 robots of which 20 are in range.

A real router, processes that replay many robots each (`scale_site`), and an ego's monitor, analysis
and plan in a process of their own, which fetches no frames. Bytes are the kernel's count of what
the control class has brought to the ego. With areas, as `make up` sets them, and, as a control, the
same site without. Apart from this: cycles with up to 250 robots in range, without a network.

A machine that has no time for 12,000 messages a second plays robots that speak less often
(`--beacon-hz 2`): beside bytes a second stand bytes for each round of beacons, which depend on no
clock.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from deploy.ports import LOCALHOST
from deploy.spec import AREAS_FROM
from ego_agent.analyze.doubts import doubted
from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.objective import Objective
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.monitor.surroundings import Surroundings
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.registry import make_policy
from research.benchmarks import cycle
from research.benchmarks.controller import cpu_s
from research.benchmarks.processes import WAIT_S, free_ports, process
from research.benchmarks.report import write_report
from research.benchmarks.scale_site import BEACON_HZ, EGO, IN_RANGE, RANGE_M, SWARM, Replayed
from swarm.log import make_logger
from swarm.memory import collect_rarely
from swarm.messages import Decision
from swarm.session import Session
from swarm.tcp.info import connections, tcp_info
from swarm.traffic import TrafficClass

SITES = (10, 50, 100, 250, 1000)
CONTROLS = (100, 1000)
"""Sizes that are also run without areas."""
CROWDS = (50, 100, 250)
"""Robots in range, without a network."""
PERIOD_S = 0.5
CYCLES, WARM_UP, CROWD_CYCLES = 40, 10, 100
PROCESSES = 2
"""That share the robots."""


def received_bytes() -> int:
    """What the control class has brought to this process so far, by its kernel."""
    told = (tcp_info(one.descriptor) for one in connections(TrafficClass.CONTROL))
    return sum(one.received_bytes for one in told if one is not None)


def decide(router: str, robots: int, areas: bool) -> dict[str, Any]:
    """An ego's cycles at the site's middle, and what they took: this process is the ego."""
    objective = Objective(comm_range_m=RANGE_M)
    knowledge = Knowledge(objective)
    policy = make_policy("coverage", knowledge.algorithms)
    around = Surroundings(RANGE_M, objective.area_half_m, make_logger("ego")) if areas else None
    monitor = Monitor(EGO, LinkEstimate(55e6), surroundings=around)
    own = Replayed(0, areas)
    previous: Decision | None = None
    walls, cycles_s, known = [], 0.0, []
    with Session(router, SWARM, timeout_s=WAIT_S) as session:
        empty = received_bytes()
        monitor.note_own(*own.own())
        monitor.attach(session)
        # Those at the edge of the range drive to and fro.
        enough = min(robots - 1, IN_RANGE - 2)
        _await(lambda: len(_candidates(monitor, knowledge, own)) >= enough)
        first_bytes = received_bytes() - empty
        due = time.monotonic()
        for number in range(WARM_UP + CYCLES):
            if number == WARM_UP:
                print("begins", flush=True)
                begun, begun_cpu, begun_bytes = (
                    time.monotonic(),
                    time.process_time(),
                    received_bytes(),
                )
                cycles_s, begun_seq = 0.0, _seq(monitor)
            monitor.note_own(*own.own())
            now_ns, wall, cpu = time.time_ns(), time.perf_counter(), time.thread_time()
            snapshot = monitor.snapshot(number, now_ns)
            scene = analyze(snapshot, knowledge)
            previous = plan(snapshot, scene, policy, knowledge, previous, number, now_ns)
            doubted(snapshot, objective, cycle.BODY)
            walls.append((time.perf_counter() - wall) * 1e3)
            cycles_s += time.thread_time() - cpu
            known.append((len(snapshot.robots), len(scene.candidates)))
            due += PERIOD_S
            time.sleep(max(0.0, due - time.monotonic()))
        spent_s = time.monotonic() - begun
        took, size = time.process_time() - begun_cpu, received_bytes() - begun_bytes
        rounds = _seq(monitor) - begun_seq
        monitor.close()
    walls = walls[WARM_UP:]
    return {
        "robots": robots,
        "areas": areas,
        "in_range": float(np.median([found for _, found in known])),
        "monitored": float(np.median([heard for heard, _ in known])),
        "cycle_p50_ms": float(np.percentile(walls, 50)),
        "cycle_p99_ms": float(np.percentile(walls, 99)),
        "cycle_cpu_ms": cycles_s / CYCLES * 1e3,
        "ego_cpu": took / spent_s,
        "control_bytes_s": size / spent_s,
        "heard_hz": rounds / spent_s,
        "control_bytes_a_round": size / max(1, rounds),
        "join_bytes": first_bytes,
        "cycle_ms": [round(wall, 3) for wall in walls],
    }


def _seq(monitor: Monitor) -> int:
    """Of the nearest robot's newest beacon."""
    view = monitor.snapshot(0, 0).robots["R2"]
    return view.beacon.seq if view.beacon is not None else 0


def _candidates(monitor: Monitor, knowledge: Knowledge, own: Replayed) -> tuple[object, ...]:
    monitor.note_own(*own.own())
    return analyze(monitor.snapshot(0, time.time_ns()), knowledge).candidates


def _await(condition: Any) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"the robots in range are not heard within {WAIT_S:.0f} s")
        time.sleep(0.2)


@contextmanager
def site(robots: int, areas: bool, beacon_hz: float) -> Iterator[tuple[str, int]]:
    """A router's address and process id, and robots that speak there."""
    first = free_ports(3)
    router = f"tcp/{LOCALHOST}:{first}"
    words = ["--router", router, "--robots", str(robots), *(["--areas"] if areas else [])]
    words += ["--beacon-hz", str(beacon_hz)]
    with ExitStack() as stack:
        routing = stack.enter_context(process("swarm.router", "--port", str(first)))
        for part in range(PROCESSES):
            speaking = stack.enter_context(
                process("research.benchmarks.scale_site", *words, "--of", f"{part}/{PROCESSES}")
            )
            assert speaking.stdout is not None
            speaking.stdout.readline()
        yield router, routing.pid


def measure(robots: int, areas: bool, beacon_hz: float) -> dict[str, Any]:
    """One site: its figures."""
    with site(robots, areas, beacon_hz) as (router, pid):
        words = ["--router", router, "--robots", str(robots), *(["--areas"] if areas else [])]
        with process("research.benchmarks.scale", *words) as ego:
            assert ego.stdout is not None
            ego.stdout.readline()  # It measures from now on.
            begun, before = time.monotonic(), cpu_s(pid)
            told = ego.stdout.readline()
            router_cpu = (cpu_s(pid) - before) / (time.monotonic() - begun)
    if not told:
        raise RuntimeError(f"the ego of {robots} robots has ended")
    figures: dict[str, Any] = json.loads(told)
    return {**figures, "router_cpu": router_cpu}


def crowd(robots: int) -> dict[str, float]:
    """Cycles with so many robots in range; also the processor time that they take, which other work
    on the machine does not change much, and that of telling why after each."""
    walls = cycle.run(robots, CROWD_CYCLES).cycles
    times = cycle.run(robots, CROWD_CYCLES, time.thread_time)
    spent = times.cycles
    return {
        "in_range": robots,
        "p50_ms": float(np.percentile(walls, 50)),
        "p99_ms": float(np.percentile(walls, 99)),
        "cpu_p50_ms": float(np.percentile(spent, 50)),
        "cpu_p99_ms": float(np.percentile(spent, 99)),
        "reasons_cpu_p50_ms": float(np.percentile(times.reasons, 50)),
    }


def main() -> None:
    """Measures and writes build/bench/scale.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--router", help=argparse.SUPPRESS)
    parser.add_argument("--robots", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--areas", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--beacon-hz", type=float, default=BEACON_HZ)
    args = parser.parse_args()
    collect_rarely()  # as the ego's process does
    if args.router:
        print(json.dumps(decide(args.router, args.robots, args.areas)), flush=True)
        return
    crowds = [crowd(robots) for robots in CROWDS]
    found = [measure(robots, robots >= AREAS_FROM, args.beacon_hz) for robots in SITES]
    controls = [measure(robots, False, args.beacon_hz) for robots in CONTROLS]
    samples = {f"cycle_ms_{one['robots']}": one.pop("cycle_ms") for one in found}
    for one in controls:
        one.pop("cycle_ms")
    few, many = (next(one for one in found if one["robots"] == size) for size in (100, 1000))
    figures = {
        "cycle_growth": many["cycle_cpu_ms"] / few["cycle_cpu_ms"],
        "cycle_p50_growth": many["cycle_p50_ms"] / few["cycle_p50_ms"],
        "bytes_growth": many["control_bytes_a_round"] / few["control_bytes_a_round"],
        "beacon_hz": args.beacon_hz,
        "p99_ms_250_in_range": crowds[-1]["p99_ms"],
        "cpu_p99_ms_250_in_range": crowds[-1]["cpu_p99_ms"],
        "rows": found,
        "controls": controls,
        "crowds": crowds,
    }
    print(write_report("scale", figures, samples))
    for row in (*crowds, *found, *controls):
        print({name: round(value, 3) for name, value in row.items()})


if __name__ == "__main__":
    main()
