"""Robots whose contributions cannot be laid where they belong are asked less, and tried again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.placing import MOST_ROBOTS, Placing
from ego_agent.plan.choices.explain import explain
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.coverage import Coverage
from tests.support.ego_scenes import NOW_NS, candidate, knowledge, scene, snapshot, view


class Steady:
    """A clock that goes when it is told to."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def left_out(placing: Placing, times: int, robot: str = "R2") -> Placing:
    for _ in range(times):
        placing.record(robot, placed=False)
    return placing


def test_who_was_never_tried_is_believed() -> None:
    assert Placing().share("R2") == 1.0


@pytest.mark.parametrize("times", [1, 10, 100])
def test_what_is_left_out_again_and_again_is_expected_to_be_left_out(times: int) -> None:
    placing = left_out(Placing(Steady()), times)
    assert {1: 0.6, 10: 0.1, 100: 0.0}[times] < placing.share("R2") <= 2.0 / (1.5 + times / 10)
    assert placing.share("R3") == 1.0


def test_one_that_is_fused_again_is_believed_again() -> None:
    placing = left_out(Placing(Steady()), 20)
    for _ in range(40):
        placing.record("R2", placed=True)
    assert placing.share("R2") > 0.9


def test_it_is_tried_again_after_a_while() -> None:
    clock = Steady()
    placing = left_out(Placing(clock), 20)
    shares = []
    for _ in range(6):
        shares.append(placing.share("R2"))
        clock.now_s += 30.0
    assert shares == sorted(shares)
    assert shares[0] < 0.15
    assert shares[-1] > 0.7


def test_a_clock_that_stands_still_or_goes_back_forgets_nothing() -> None:
    clock = Steady()
    placing = left_out(Placing(clock), 20)
    share = placing.share("R2")
    clock.now_s -= 100.0
    assert placing.share("R2") == share


def test_no_more_robots_are_remembered_than_it_may() -> None:
    placing = Placing(Steady())
    for number in range(MOST_ROBOTS + 10):
        placing.record(f"R{number}", placed=False)
    assert placing.share("R0") == 1.0
    assert placing.share(f"R{MOST_ROBOTS + 9}") < 1.0


def test_a_robot_that_cannot_be_placed_leaves_its_part_to_another() -> None:
    ego = candidate("E", range(20))
    first, second = candidate("A", range(20, 50)), candidate("B", range(20, 50))
    both = scene(ego, first, second)
    lost = scene(ego, replace(first, placed=0.1), second)
    known = knowledge()
    chosen = [plan(snapshot(), s, Coverage(), known, None, 7, NOW_NS) for s in (both, lost)]
    assert chosen[0].participants == ("E", "A")
    assert chosen[1].participants[:2] == ("E", "B")
    assert "90 % of what A sends cannot be laid in its place" in chosen[1].reason
    assert chosen[1].arrival["B"] == 1.0
    told = {c["robot"]: c["placed"] for c in explain(lost, known)["candidates"]}
    assert told == {"A": 0.1, "B": 1.0}


@pytest.mark.parametrize(("learns", "placed"), [(True, 0.1), (False, 1.0)])
def test_the_scene_tells_what_was_learnt(learns: bool, placed: float) -> None:
    known = Knowledge(learns=learns)
    left_out(known.placing, 50, "R2")
    found = analyze(snapshot(view("E"), view("R2", x=5.0)), known)
    (other,) = found.candidates
    assert other.placed == pytest.approx(placed, abs=0.05)
