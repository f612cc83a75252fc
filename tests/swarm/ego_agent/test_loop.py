"""The closed loop without a network: decisions teach, and what was taught changes decisions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import msgspec
import pytest

from ego_agent.execute.lessons import PROBE_FRAMES
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.experience import frames_of
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import (
    MAX_DEADLINE_S,
    RARER_HZ,
    SLOWER_HZ,
    Pace,
    algorithm_of,
    due,
    paces,
    rate_of,
    stride,
)
from ego_agent.plan.choices.explain import explain
from ego_agent.plan.decision import plan
from ego_agent.plan.demand import need
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.policies.registry import make_policy
from ego_agent.plan.probe import FIRST_S, LAST_S, Prober
from swarm.messages import Decision, Probe
from tests.support.ego_scenes import NOW_NS, assert_valid, candidate, snapshot

SECOND_NS = 10**9
SIZES = {"early": 12_000, "late": 600}
Answer = Callable[[str, str, float], float]
"""Seconds that a robot takes with an algorithm at a rate; infinite: it never answers."""


@dataclass
class Rig:
    """An ego whose robots answer as they are told to; time goes by cycles of a second."""

    answer: Answer
    policy: str = "coverage"
    capacity_bps: float = 20e6
    robots: int = 5
    known: Knowledge = field(default_factory=lambda: live())
    now_s: float = 5000.0
    decisions: list[Decision] = field(default_factory=list)
    probes: list[tuple[float, Probe]] = field(default_factory=list)
    frame: int = 0
    sizes: Mapping[str, int] = field(default_factory=lambda: SIZES)

    def __post_init__(self) -> None:
        self.known.experience._clock = lambda: self.now_s
        self.prober = Prober()

    def scene(self) -> UnifiedScene:
        others = []
        learnt = self.known.experience.learnt(self.capacity_bps)
        for number in range(self.robots):
            robot = f"R{number + 1}"
            cells = range(12 + 10 * number, 22 + 10 * number)
            answers = learnt.of(robot, self.sizes) if self.known.learns else {}
            seen = candidate(robot, cells, sizes=self.sizes)
            others.append(replace(seen, answers=answers))
        return UnifiedScene(
            ego=candidate("E", range(12)),
            candidates=tuple(others),
            excluded={},
            objects=candidate("E").evidence.reshape(-1, 1)[:, [0, 0, 0]],
            cell_m=1.0,
            capacity_bps=self.capacity_bps,
        )

    def cycle(self) -> Decision:
        previous = self.decisions[-1] if self.decisions else None
        scene = self.scene()
        now_ns = NOW_NS + round(self.now_s * 1e9)
        policy = make_policy(self.policy, self.known.algorithms)
        decision = plan(
            snapshot(), scene, policy, self.known, previous, len(self.decisions), now_ns
        )
        assert_valid(decision, scene, self.known)
        probe = self.prober.take(scene, self.known, decision, self.now_s)
        decision = msgspec.structs.replace(decision, probe=probe)
        self.decisions.append(decision)
        if probe is not None:
            self.probes.append((self.now_s, probe))
            self._tell(probe.robot, probe.algorithm, 0.1)
        frames = round(decision.rate_hz)
        for _ in range(frames):
            self.now_s += 1.0 / frames
            for robot in decision.participants[1:]:
                if due(decision, robot, self.frame):
                    algorithm, rate_hz = algorithm_of(decision, robot), rate_of(decision, robot)
                    self._tell(robot, algorithm, rate_hz, decision.deadline_s)
            self.frame += 1
        return decision

    def _tell(
        self, robot: str, algorithm: str, rate_hz: float, deadline_s: float | None = None
    ) -> None:
        """As Execute does; without a deadline it is the answer to a probe."""
        took_s = self.answer(robot, algorithm, rate_hz)
        late = deadline_s is not None and took_s > deadline_s
        record = partial(
            self.known.experience.record,
            robot,
            algorithm,
            frames=PROBE_FRAMES
            if deadline_s is None
            else frames_of(min(took_s, 1.5), rate_hz, 10.0),
            capacity_bps=self.capacity_bps,
        )
        if late and deadline_s is not None:
            record(deadline_s * 1.001, at_least=True)
        record(took_s)

    def arrives(self, decision: Decision) -> float:
        """Share of the participants whose answers really meet the decision's deadline."""
        asked = decision.participants[1:]
        took = [self.answer(r, decision.algorithm, decision.rate_hz) for r in asked]
        return sum(s <= (decision.deadline_s or 0.25) for s in took) / len(took) if took else 0.0

    def changes(self) -> int:
        choices = [(d.participants, d.algorithm, d.rate_hz) for d in self.decisions]
        return sum(a != b for a, b in itertools.pairwise(choices))


def live(**objective: Any) -> Knowledge:
    return Knowledge(Objective(slower_hz=SLOWER_HZ, **objective), ("early", "late"))


def quick(robot: str, algorithm: str, rate_hz: float) -> float:
    return 0.1


def test_while_everything_arrives_the_decision_is_that_of_an_ego_that_learns_nothing() -> None:
    rig, dull = (
        Rig(quick),
        Rig(quick, known=Knowledge(Objective(), ("early", "late"), learns=False)),
    )
    for _ in range(15):
        rig.cycle()
        dull.cycle()
    seen = [(d.participants, d.algorithm, d.rate_hz, d.quality) for d in rig.decisions]
    assert seen == [(d.participants, d.algorithm, d.rate_hz, d.quality) for d in dull.decisions]
    assert rig.probes == []


@pytest.mark.parametrize("policy", ["coverage", "static-late"])
def test_a_planner_whose_answers_take_too_long_finds_a_pace_at_which_they_arrive(
    policy: str,
) -> None:
    rig = Rig(lambda robot, algorithm, rate: 0.35, policy=policy)
    for _ in range(6):
        decision = rig.cycle()
    assert len(decision.participants) == 6
    assert decision.deadline_s is not None
    assert decision.deadline_s >= 0.35
    assert rig.arrives(decision) == 1.0
    assert rig.changes() <= 2


def test_a_planner_that_finds_that_nothing_arrives_changes_its_mind_within_five_cycles() -> None:
    trouble = [False]

    def answer(robot: str, algorithm: str, rate_hz: float) -> float:
        return math.inf if trouble[0] and algorithm == "late" else 0.1

    rig = Rig(answer, capacity_bps=2e6)
    for _ in range(20):
        before = rig.cycle()
    assert before.algorithm == "late"
    trouble[0] = True
    arrives = [rig.arrives(rig.cycle()) for _ in range(12)]
    assert max(arrives[:6]) >= 0.9
    assert min(arrives[5:]) >= 0.9


def test_the_way_back_is_probed_by_one_robot_and_one_frame_at_growing_intervals() -> None:
    rig = Rig(lambda robot, algorithm, rate: 9.0 if algorithm == "early" else 0.05)
    for _ in range(240):
        rig.cycle()
    assert rig.decisions[-1].algorithm == "late"
    times = [at for at, _ in rig.probes]
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert 4 <= len(times) <= 9
    assert all(probe.algorithm == "early" for _, probe in rig.probes)
    assert gaps == sorted(gaps)
    assert FIRST_S <= gaps[0] < gaps[-1] <= LAST_S + 2
    assert rig.changes() <= 240 / 10


def test_when_probes_come_in_time_the_planner_goes_back() -> None:
    slow = [True]

    def answer(robot: str, algorithm: str, rate_hz: float) -> float:
        return 9.0 if slow[0] and algorithm == "early" else 0.05

    rig = Rig(answer)
    for _ in range(20):
        rig.cycle()
    assert rig.decisions[-1].algorithm == "late"
    slow[0] = False
    for _ in range(45):
        rig.cycle()
    assert rig.decisions[-1].algorithm == "early"
    assert len(rig.decisions[-1].participants) == 6


def test_points_that_were_late_while_a_queue_drained_come_back_at_lower_rates() -> None:
    """After a drop of the link the first answers wait behind what was asked before: that is no
    reason to be content with boxes on a tenth of the link."""
    drains = [False]

    def answer(robot: str, algorithm: str, rate_hz: float) -> float:
        return 2.0 if drains[0] and algorithm == "early" else 0.05

    objective = Objective(slower_hz=SLOWER_HZ, rarer_hz=RARER_HZ)
    known = Knowledge.of_detector("factory", objective, ("early", "late"))
    rig = Rig(answer, known=known, sizes={"early": 3400, "late": 485})
    for _ in range(20):
        rig.cycle()
    rig.capacity_bps, drains[0] = 1e6, True
    for _ in range(3):
        rig.cycle()
    drains[0] = False
    boxes = [rig.cycle() for _ in range(5)][-1]
    assert "early" not in {algorithm_of(boxes, robot) for robot in boxes.participants[1:]}
    for _ in range(30):
        decision = rig.cycle()
    forms = [algorithm_of(decision, robot) for robot in decision.participants[1:]]
    assert forms.count("early") >= 3
    assert decision.quality > boxes.quality + 0.05
    assert decision.cost_bytes * 8 * decision.rate_hz <= 0.8 * rig.capacity_bps


def test_a_probe_never_asks_for_more_than_the_link_carries() -> None:
    rig = Rig(lambda robot, algorithm, rate: 9.0 if algorithm == "early" else 0.05)
    for _ in range(3):
        rig.cycle()
    rig.capacity_bps = 0.3e6
    asked = len(rig.probes)
    for _ in range(40):
        decision = rig.cycle()
        spent_bps = 8 * decision.cost_bytes * decision.rate_hz
        for _, probe in rig.probes[asked:]:
            assert 8 * probe.bytes + spent_bps <= 0.8 * rig.capacity_bps + 1


def test_a_robot_ten_times_slower_than_the_others_is_left_out_and_told_about() -> None:
    rig = Rig(lambda robot, algorithm, rate: 2.0 if robot == "R4" else 0.05)
    for _ in range(30):
        decision = rig.cycle()
    assert set(decision.participants) >= {"E", "R1", "R2", "R3", "R5"}
    assert decision.arrival["R1"] == 1.0
    assert "R4 arrives in time in" in decision.reason
    offered = {c["robot"]: c["answers"] for c in explain(rig.scene(), rig.known)["candidates"]}
    assert offered["R4"]["early"]["in_time"]["10"] < 0.5
    assert offered["R1"]["early"]["in_time"]["10"] == 1.0


def test_on_a_link_that_does_not_change_decisions_change_at_most_every_ten_seconds() -> None:
    cycles = [0]

    def wavering(robot: str, algorithm: str, rate_hz: float) -> float:
        cycles[0] += 1
        return 0.2 if (cycles[0] * 7919) % 100 < 80 else 0.3

    rig = Rig(wavering)
    for _ in range(120):
        rig.cycle()
    assert rig.changes() <= 12


def test_dwelling_ends_when_quality_is_lost_and_never_outlasts_what_the_link_carries() -> None:
    rig = Rig(quick, known=Knowledge(Objective(lambda_link=0), ("early", "late")), capacity_bps=6e6)
    assert rig.cycle().algorithm == "early"
    rig.capacity_bps = 4e6
    assert rig.cycle().algorithm == "late"
    rig.capacity_bps = 7e6
    waited = [rig.cycle().algorithm for _ in range(12)]
    assert waited[0] == "late", "an upgrade waits"
    assert waited[-1] == "early"
    rig.capacity_bps = 0.4e6
    assert rig.cycle().algorithm == "late"
    rig.capacity_bps = 20e6
    assert rig.cycle().algorithm == "early", "another link is no reason to wait"


def test_the_time_that_a_decision_has_been_held_survives_a_clock_that_jumps() -> None:
    rig = Rig(quick)
    rig.cycle()
    scene, policy = rig.scene(), Coverage()
    for jump_s, least, most in ((3600.0, 5.0, 5.0), (-7200.0, 0.0, 0.0)):
        before = rig.decisions[-1]
        after_ns = before.decided_ns + round(jump_s * SECOND_NS)
        decision = plan(snapshot(), scene, policy, rig.known, before, 9, after_ns)
        assert decision.held_s is not None
        assert least <= decision.held_s <= most


def test_what_q_min_takes_of_the_link_does_not_depend_on_who_is_late() -> None:
    rig = Rig(lambda robot, algorithm, rate: math.inf)
    before = need(rig.scene(), rig.known)
    for _ in range(10):
        rig.cycle()
    assert need(rig.scene(), rig.known) == before
    assert before.possible


def test_a_slower_pace_waits_longer_and_is_worth_less() -> None:
    fastest, *slower = paces(Objective(slower_hz=SLOWER_HZ))
    assert (fastest, len(slower)) == (Pace(10.0, 0.25), 4)
    assert [p.deadline_s for p in slower] == [0.25, 0.4, 0.5, MAX_DEADLINE_S]
    worth = [pace.freshness(fastest, 0.0) for pace in (fastest, *slower)]
    assert worth[0] == 1.0
    assert worth == sorted(worth, reverse=True)
    assert fastest.freshness(fastest, 0.2) == Pace(5.0, 0.25).freshness(fastest, 0.0)


def test_execute_follows_the_decided_rate_up_to_the_set_one() -> None:
    decision = Rig(quick).cycle()
    slow = msgspec.structs.replace(decision, rate_hz=2.5)
    assert [stride(d, 10.0, 10.0) for d in (decision, slow)] == [1, 4]
    assert stride(decision, 10.0, 5.0) == 2
