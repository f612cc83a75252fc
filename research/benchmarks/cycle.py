"""Time of the ego's control cycle: from Monitor's snapshot to the valid decision of `coverage` and
whom it doubts, and, apart, of what follows it: the demand that is told the network controller, and
what the journal tells of why.

The messages of a synthetic floor go through the real Monitor, encoded and decoded as on the wire;
only the cycle itself is timed. Between two cycles every robot moves, sees other things, and C(t)
changes, so that nothing can be carried over. Some robots' answers are late now and then.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ego_agent.analyze.doubts import doubted
from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import RARER_HZ, SLOWER_HZ
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.plan.choices.options import Compared
from ego_agent.plan.choices.weigh import weigh
from ego_agent.plan.decision import plan
from ego_agent.plan.demand import DemandMeter
from ego_agent.plan.policies.registry import make_policy
from perception.detector import configuration
from research.benchmarks.report import write_report
from swarm.arrays import pack
from swarm.messages import (
    Beacon,
    Decision,
    LinkState,
    Message,
    NetState,
    SceneDescription,
    decode,
    encode,
)

ROBOTS = (6, 12, 50)
BODY = configuration("factory").usual_body
CYCLES = 400
WARM_UP = 20
OBJECTS_A_ROBOT = 60
SECTORS = 72
FLOOR_M = 40.0
"""Half the side of the square in which robots and objects are: all are within 45 m or nearly."""


class Floor:
    """A floor of things and robots that move; `messages` is one period's traffic."""

    def __init__(self, robots: int, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._ids = [f"R{i + 1}" for i in range(robots)]
        self._things = self._rng.uniform(-FLOOR_M - 20, FLOOR_M + 20, (220, 2))
        self._places = self._rng.uniform(-FLOOR_M * 0.7, FLOOR_M * 0.7, (robots, 2))
        self._step = 0

    def messages(self) -> Iterator[Message]:
        """Beacons and scene descriptions of all robots after all have moved, and the link."""
        self._step += 1
        self._places += self._rng.normal(0.0, 0.5, self._places.shape)
        np.clip(self._places, -FLOOR_M, FLOOR_M, out=self._places)
        now_ns = time.time_ns()
        for robot, place in zip(self._ids, self._places, strict=True):
            pose = (float(place[0]), float(place[1]), 1.5, 0.0, 0.0, 0.0)
            yield Beacon(
                robot=robot,
                instance=1,
                seq=self._step,
                sent_ns=now_ns,
                capture_ns=now_ns,
                frame=self._step,
                pose=pose,
                velocity=(0.0, 0.0, 0.0),
                range_m=50.0,
                sizes={
                    "early": int(self._rng.integers(9_000, 16_000)),
                    "late": int(self._rng.integers(300, 1_500)),
                },
            )
            yield SceneDescription(
                robot=robot,
                instance=1,
                seq=self._step,
                sent_ns=now_ns,
                capture_ns=now_ns,
                frame=self._step,
                pose=pose,
                objects=pack(self._seen_from(place)),
                visible_m=pack(self._rng.uniform(5, 50, (SECTORS, 1)).astype(np.float32)),
                ground_points=20_000,
                elapsed_ms=4.0,
            )
        yield self._net_state(now_ns)

    def _net_state(self, now_ns: int) -> NetState:
        capacity_bps = int(self._rng.uniform(1e6, 20e6))
        cell = LinkState(
            robot=self._ids[0],
            direction="down",
            capacity_bps=capacity_bps,
            available_bps=capacity_bps,
            latency_ms=0.0,
            level=0,
            classes={},
        )
        return NetState(controller=1, seq=self._step, sent_ns=now_ns, links=(cell,))

    def _seen_from(self, place: np.ndarray) -> np.ndarray:
        """The nearest things, float32 (N, 9) as in a scene description, with noise."""
        distance = np.hypot(*(self._things - place).T)
        nearest = np.argsort(distance)[:OBJECTS_A_ROBOT]
        objects = np.ones((OBJECTS_A_ROBOT, 9), dtype=np.float32)
        objects[:, :2] = self._things[nearest] + self._rng.normal(0, 0.2, (OBJECTS_A_ROBOT, 2))
        objects[:, 3] = distance[nearest]
        objects[:, 7] = np.maximum(5, 20_000 / np.maximum(1, distance[nearest]) ** 2)
        return objects


@dataclass(frozen=True, slots=True)
class Times:
    """Milliseconds of each cycle, and of what follows it."""

    cycles: list[float] = field(default_factory=list)
    demands: list[float] = field(default_factory=list)
    reasons: list[float] = field(default_factory=list)
    """What the journal tells of why."""


def run(
    robots: int,
    cycles: int = CYCLES,
    clock: Callable[[], float] = time.perf_counter,
    *,
    rarer: bool = False,
) -> Times:
    """Cycles with that many robots, the ego included. `clock` tells seconds. `rarer`: each robot
    with an algorithm and a rate of its own."""
    floor = Floor(robots, seed=robots)
    rates = RARER_HZ if rarer else ()
    objective = Objective(slower_hz=SLOWER_HZ, rarer_hz=rates)
    knowledge = Knowledge.of_detector("factory", objective) if rarer else Knowledge(objective)
    policy = make_policy("coverage", knowledge.algorithms)
    monitor = Monitor("R1", LinkEstimate(20e6))
    for number in range(robots):
        monitor.on_join(f"R{number + 1}")
    rng = np.random.default_rng(robots)
    previous: Decision | None = None
    compared: list[Compared] = []
    meter, times = DemandMeter(), Times()
    for cycle in range(WARM_UP + cycles):
        _feed(monitor, floor)
        _answers(knowledge, rng, robots)
        begun = clock()
        now_ns = time.time_ns()
        snapshot = monitor.snapshot(cycle, now_ns)
        scene = analyze(snapshot, knowledge)
        previous = plan(
            snapshot,
            scene,
            policy,
            knowledge,
            previous,
            cycle,
            now_ns,
            on_compared=compared.append,
        )
        doubted(snapshot, knowledge.objective, BODY)
        decided = clock()
        meter.take(scene, knowledge, previous, sent_ns=now_ns, now_s=time.monotonic())
        demanded = clock()
        weigh(compared.pop(), previous)
        told = clock()
        if not previous.valid or previous.source != "policy":
            raise RuntimeError(f"cycle {cycle} was not decided by coverage: {previous}")
        if cycle >= WARM_UP:
            times.cycles.append((decided - begun) * 1e3)
            times.demands.append((demanded - decided) * 1e3)
            times.reasons.append((told - demanded) * 1e3)
    return times


def _answers(knowledge: Knowledge, rng: np.random.Generator, robots: int) -> None:
    """What the robots' answers of a period teach: every third robot is late now and then, so that
    expected coverage has to be counted out."""
    for number in range(1, robots):
        for algorithm in knowledge.algorithms:
            slow = number % 3 == 0 and rng.random() < 0.3
            knowledge.experience.record(f"R{number + 1}", algorithm, 0.4 if slow else 0.1)


def _feed(monitor: Monitor, floor: Floor) -> None:
    """One period's messages, as bytes off the wire; the ego's own come from its own sensor."""
    own: Beacon | None = None
    for message in floor.messages():
        received = decode(encode(message), type(message))
        if isinstance(received, Beacon):
            own = received if received.robot == monitor.ego else own
            monitor.on_beacon(received)
        elif isinstance(received, SceneDescription):
            if received.robot == monitor.ego and own is not None:
                monitor.note_own(own, received)
            monitor.on_scene(received)
        elif isinstance(received, NetState):
            monitor.on_net_state(received)


def _percentiles(times: list[float]) -> tuple[float, float]:
    """Of milliseconds, p50 and p99."""
    p50, p99 = (round(float(np.percentile(times, q)), 3) for q in (50, 99))
    return p50, p99


def main() -> None:
    """Measures and writes build/bench/cycle.json."""
    figures: dict[str, object] = {}
    rows = []
    samples = {}
    for robots in ROBOTS:
        gc.collect()
        taken = run(robots)
        assigned = run(robots, rarer=True)
        p50, p99 = _percentiles(taken.cycles)
        figures[f"p99_ms_{robots}"] = p99
        figures[f"p50_ms_{robots}"] = p50
        assigned_p50, assigned_p99 = _percentiles(assigned.cycles)
        figures[f"assigned_p50_ms_{robots}"] = assigned_p50
        figures[f"assigned_p99_ms_{robots}"] = assigned_p99
        demand_p50, demand_p99 = _percentiles(taken.demands)
        figures[f"demand_p99_ms_{robots}"] = demand_p99
        rows.append(
            {
                "robots": robots,
                "p50_ms": p50,
                "p99_ms": p99,
                "max_ms": round(max(taken.cycles), 3),
                "assigned_p50_ms": assigned_p50,
                "assigned_p99_ms": assigned_p99,
                "demand_p50_ms": demand_p50,
                "demand_p99_ms": demand_p99,
                "reasons_p50_ms": _percentiles(taken.reasons)[0],
                "assigned_reasons_p50_ms": _percentiles(assigned.reasons)[0],
            }
        )
        samples[f"ms_{robots}"] = [round(t, 3) for t in taken.cycles]
    figures["rows"] = rows
    figures["objects_per_robot"] = OBJECTS_A_ROBOT
    print(write_report("cycle", figures, samples))
    for row in rows:
        print(row)


if __name__ == "__main__":
    main()
