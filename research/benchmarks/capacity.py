"""How near C(t) comes to what a link gives, while the machine is busy with the swarm itself.

Six robots and their ego on this machine, links of several rates, each nearly idle (an application's
datagrams with fusion's mark take 5 %) and full (an application's TCP stream with that mark takes
what it gets; on the unshaped link datagrams of as much as the setting says). What is held against
C(t) is what fusion can have: the configured rate less what control was counted to take, on the
unshaped link the setting. Then the controller follows a trace; then it is stopped, and the cell is
narrowed behind its back, so that only TCP's view is left.
"""

from __future__ import annotations

import argparse
import random
import re
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import kill
from pathlib import Path
from typing import Any

import numpy as np

from coadapt import net_client
from coadapt.asking import ask_patiently
from deploy.netns import network
from deploy.state import State
from network_controller import ladder
from network_controller.drivers import htb
from network_controller.mahimahi import read_trace
from research.benchmarks.live import live_swarm, process_id, why_not
from research.benchmarks.report import write_report
from research.benchmarks.stage import FIRST_PORT
from swarm import keyspace
from swarm.listening import Handlers, hear
from swarm.messages import Decision, EgoSteered, EgoSteering, EgoWish, NetState, ShapeRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

SWARM, EGO = "capacity", "R1"
RATES_BPS = (1_000_000, 5_000_000, 20_000_000, 55_000_000, 100_000_000, None)
SETTING_BPS = 55_000_000
LIGHT, FULL = 0.05, 1.0
SETTLE_S, MEASURE_S = 5.0, 10.0
TRACE_S = 30
TRACE_BPS = (1_500_000, 40_000_000)
SEEN_S = 7.0
"""Somebody has looked after the controller in it."""
STALE_S = 6.0
"""After which an ego goes on without its controller."""
ALONE_BPS = (1_000_000, 2_000_000)
FROM_BPS = 20_000_000


@dataclass(slots=True)
class CapacityLog:
    """What the swarm says, and when it came (`time.time_ns`)."""

    decisions: list[tuple[int, Decision]] = field(default_factory=list)
    states: list[tuple[int, NetState]] = field(default_factory=list)

    def capacities(self, since_ns: int) -> list[float]:
        """C(t) of the decisions since then."""
        return [d.capacity_bps for at, d in self.decisions if at >= since_ns]

    def carried_bps(self, since_ns: int) -> dict[str, float]:
        """What each class carried since then, by the kernel's counters; none when unshaped."""
        links = [s.link(EGO, "down") for at, s in self.states if at >= since_ns]
        counts = [{k: c.backlog for k, c in link.classes.items()} for link in links if link]
        if len(counts) < 2:
            return {}
        return {
            name: 8e3 * (last.sent_bytes - first.sent_bytes) / (last.seen_ms - first.seen_ms)
            for name, first in counts[0].items()
            if (last := counts[-1][name]).seen_ms > first.seen_ms
        }


class Rig:
    """A live swarm whose cell is shaped and loaded."""

    def __init__(self, state: State, session: Session) -> None:
        self.state, self.session, self.log = state, session, CapacityLog()
        self._port = FIRST_PORT
        handlers: Handlers = {
            Decision: lambda d: self.log.decisions.append((time.time_ns(), d)),
            NetState: lambda s: self.log.states.append((time.time_ns(), s)),
        }
        hear(session, handlers, EGO)

    def shape(self, rate_bps: int | None) -> None:
        """Has the controller shape the cell; None: not at all."""
        if rate_bps is None:
            net_client.ask(self.session, ShapeRequest(profile="off", robot=EGO))
        else:
            net_client.ask(self.session, ShapeRequest(profile="rate", rate_bps=rate_bps))

    def policy(self, name: str) -> None:
        """Has the ego decide by another policy."""
        wish = EgoSteering(wish=EgoWish(policy=name))
        ask_patiently(self.session, keyspace.ego_steering(SWARM, EGO), wish, EgoSteered)

    def inside(self, module: str, *command: str) -> list[str]:
        """A command in the network namespace of a process of the swarm."""
        return ["nsenter", f"--net=/proc/{process_id(self.state, module)}/ns/net", *command]

    @contextmanager
    def load(self, protocol: str, rate_bps: float = 0.0) -> Iterator[None]:
        """An application's traffic towards the ego, with fusion's mark."""
        self._port += 1
        seconds = str(SETTLE_S + MEASURE_S + 1.0)
        common = ("--port", str(self._port), "--seconds", seconds)
        program = (sys.executable, "-m", "research.benchmarks.flow")
        ends = (
            (*self.inside("ego_agent", *program), "receive", *common),
            (
                *self.inside("network_controller", *program),
                *("send", *common, "--to", network.address(self.state.spec, EGO)),
                *("--tos", str(TrafficClass.FUSION.tos), "--protocol", protocol),
                *("--rate-bps", str(rate_bps)),
            ),
        )
        flow = [subprocess.Popen(end, stdout=subprocess.DEVNULL) for end in ends]
        try:
            yield
        finally:
            for process in flow:
                process.kill()
                process.wait()


def spread(found: Sequence[float]) -> float:
    """The 95th percentile over the fifth."""
    high, low = np.percentile(found, [95, 5])
    return round(float(high / low), 3)


def row(rig: Rig, rate_bps: int | None, load: float) -> dict[str, Any]:
    """One rate under one load."""
    wanted = load * (rate_bps or SETTING_BPS)
    greedy = load == FULL and rate_bps is not None
    with rig.load("tcp" if greedy else "udp", wanted):
        time.sleep(SETTLE_S)
        since_ns = time.time_ns()
        time.sleep(MEASURE_S)
        found, carried = rig.log.capacities(since_ns), rig.log.carried_bps(since_ns)
    fusion_bps = (rate_bps or SETTING_BPS) - carried.get("control", 0.0)
    return {
        "rate_bps": rate_bps,
        "load": load,
        "controller": True,
        "carried_ratio": round(sum(carried.values()) / (rate_bps or SETTING_BPS), 3),
        "fusion_bps": round(fusion_bps),
        "median_ratio": round(statistics.median(found) / fusion_bps, 3),
        "median_ratio_of_rate": round(statistics.median(found) / (rate_bps or SETTING_BPS), 3),
        "p95_over_p5": spread(found),
        "capacity_bps": [round(c) for c in found],
    }


def follow(rig: Rig, rates_bps: tuple[int, ...]) -> dict[str, Any]:
    """How far C(t) is from a trace at the time of each decision, and in each second of it."""
    request = ShapeRequest(profile="trace", rates_bps=rates_bps, interval_s=1.0)
    reply = net_client.ask(rig.session, request)
    begun_ns = next(s.since_ns for s in reply.shapes if s.robot == EGO)
    time.sleep(len(rates_bps))
    end_ns = begun_ns + len(rates_bps) * 10**9
    control_bps = rig.log.carried_bps(begun_ns).get("control", 0.0)
    gives = np.array([ladder.available_bps(r, 0, control_bps, 0.0) for r in rates_bps], float)
    made = [(d.decided_ns, d.capacity_bps) for _, d in rig.log.decisions]
    made = [(at, c) for at, c in made if begun_ns <= at < end_ns]
    errors = [abs(c - gives[(at - begun_ns) // 10**9]) for at, c in made]
    grid = np.arange(begun_ns, end_ns, 10**8)
    held = _held(grid, made)
    late = np.abs(held - gives[(grid - begun_ns) // 10**9])
    return {
        "trace_mean_error": round(float(np.mean(errors) / gives.mean()), 4),
        "trace_mean_error_held": round(float(np.nanmean(late) / gives.mean()), 4),
        "trace_s": len(rates_bps),
    }


def _held(grid: np.ndarray, made: list[tuple[int, float]]) -> np.ndarray:
    """C(t) of the newest decision at each time; NaN before the first."""
    at = np.searchsorted([when for when, _ in made], grid, side="right")
    return np.array([np.nan, *(c for _, c in made)])[at]


def alone(rig: Rig) -> Iterator[dict[str, Any]]:
    """Rows without a controller: it stands still, and the cell is another one than it said."""
    rig.policy("static-early")
    for rate_bps in ALONE_BPS:
        rig.shape(FROM_BPS)
        # A process that is held for 30 s is started anew, as is one that was whenever somebody
        # looked: each row holds it for less, and it goes on for long enough to be seen to.
        time.sleep(SEEN_S)
        controller = process_id(rig.state, "network_controller")
        kill(controller, signal.SIGSTOP)
        try:
            yield _alone_at(rig, rate_bps)
        finally:
            kill(controller, signal.SIGCONT)
    rig.policy("coverage")


def _alone_at(rig: Rig, rate_bps: int) -> dict[str, Any]:
    time.sleep(STALE_S)
    device = network.link_name(rig.state.spec, EGO)
    shape = ladder.shape(rate_bps, 0)
    lines = "\n".join(htb.lines(device, shape, shaped=True, fq_codel=False))
    command = rig.inside("network_controller", "tc", "-batch", "-")
    subprocess.run(command, input=lines, text=True, check=True)
    narrowed = len(rig.log.decisions)
    time.sleep(SETTLE_S)
    since_ns, before_bytes = time.time_ns(), _control_bytes(rig, device)
    time.sleep(MEASURE_S)
    found = rig.log.capacities(since_ns)
    # Robots say less on a narrow link, so what they said on the wide one does not count.
    control_bytes = _control_bytes(rig, device) - before_bytes
    fusion_bps = rate_bps - 8e9 * control_bytes / (time.time_ns() - since_ns)
    after = [d.capacity_bps for _, d in rig.log.decisions[narrowed:]]
    near = [c <= 1.15 * fusion_bps for c in after]
    return {
        "rate_bps": rate_bps,
        "load": "static-early",
        "controller": False,
        "fusion_bps": round(fusion_bps),
        "median_ratio": round(statistics.median(found) / fusion_bps, 3),
        "median_ratio_of_rate": round(statistics.median(found) / rate_bps, 3),
        "p95_over_p5": spread(found),
        "cycles_to_find": near.index(True) + 1 if True in near else None,
        "capacity_bps": [round(c) for c in after],
    }


def _control_bytes(rig: Rig, device: str) -> int:
    """What control traffic a shaped device has carried, by the kernel."""
    command = rig.inside("network_controller", "tc", "-s", "class", "show", "dev", device)
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    name = f"1:{htb.minor(0, htb.NUMBERS[TrafficClass.CONTROL])}"
    found = re.search(rf"^class htb {name} .*\n *Sent (\d+) bytes", shown, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"tc tells nothing of class {name} of {device}: {shown!r}")
    return int(found[1])


def synthetic_trace() -> tuple[int, ...]:
    """A random walk in the logarithm between TRACE_BPS, a second a step; always the same."""
    draw, low, high = random.Random(15), *np.log(TRACE_BPS)
    at, rates = float(low + high) / 2, []
    for _ in range(TRACE_S):
        at = min(float(high), max(float(low), at + draw.gauss(0.0, 0.35)))
        rates.append(round(float(np.exp(at))))
    return tuple(rates)


def told(one: dict[str, Any]) -> dict[str, Any]:
    """A row, once it was printed."""
    print(
        f"capacity: {one['rate_bps']} bit/s, load {one['load']}, controller {one['controller']}: "
        f"ratio {one['median_ratio']}, p95/p5 {one['p95_over_p5']}",
        flush=True,
    )
    return one


def main() -> int:
    """Measures and writes capacity.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trace", type=Path, help="a recorded trace instead of a drawn one")
    parser.add_argument("--part", choices=("rows", "trace", "alone"), help="only this part")
    args = parser.parse_args()
    why = why_not()
    if why is not None:
        print(f"capacity: left out: {why}", file=sys.stderr)
        return 0
    trace = read_trace(args.trace)[:TRACE_S] if args.trace else synthetic_trace()
    rows: list[dict[str, Any]] = []
    figures: dict[str, Any] = {}
    with live_swarm(SWARM, {}) as state, Session(state.router, SWARM, timeout_s=30.0) as session:
        rig = Rig(state, session)
        if args.part in (None, "rows"):
            for rate_bps in RATES_BPS:
                rig.shape(rate_bps)
                rows += [told(row(rig, rate_bps, load)) for load in (LIGHT, FULL)]
        if args.part in (None, "trace"):
            figures = follow(rig, trace) | {"trace": args.trace.name if args.trace else "drawn"}
        if args.part in (None, "alone"):
            rows += map(told, alone(rig))
    samples = {"capacity_bps": [one.pop("capacity_bps") for one in rows]}
    known = [one for one in rows if one["controller"]]
    if known:
        ratios = [one["median_ratio"] for one in known]
        figures |= {
            "min_median_ratio": min(ratios),
            "max_median_ratio": max(ratios),
            "max_p95_over_p5": max(one["p95_over_p5"] for one in known),
        }
    figures["rows"] = rows
    print(f"capacity: error on a trace {figures.get('trace_mean_error')}")
    write_report("capacity", figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
