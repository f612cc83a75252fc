"""Arrivals: an ego that gets nothing says so, in words, and claims no quality that it has not."""

from __future__ import annotations

from collections import Counter

import pytest

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.tally import Tally
from ego_agent.plan.arrivals import Arrivals, bounded
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.coverage import Coverage
from swarm.messages import Decision
from swarm.messages.ego import MAX_NAMED
from tests.support.ego_scenes import knowledge, snapshot, view

EGO, NEAR, FAR = view("E"), view("A", 15.0), view("B", 0.0, 30.0)


def decide(arrivals: Arrivals, *views: object) -> Decision:
    seen = snapshot(*(views or (EGO, NEAR, FAR)))  # type: ignore[arg-type]
    known = knowledge()
    scene = analyze(seen, known)
    decision = plan(seen, scene, Coverage(), known, None, 7, seen.now_ns)
    return arrivals.told(decision, seen, scene, known)


def cycle(missing: dict[str, str], **in_time: int) -> Tally:
    frames = Counter(dict.fromkeys(missing.items(), 5))
    return Tally(in_time=Counter(in_time), missing=frames, latencies_ms=[1.0] * 5)


def test_a_decision_whose_robots_answer_is_told_as_it_is() -> None:
    arrivals = Arrivals()
    before = decide(arrivals)
    assert set(before.participants) == {"E", "A", "B"}
    arrivals.take(before, cycle({}, A=5, B=5))
    after = decide(arrivals)
    assert (after.blind, after.silent, after.excluded) == ("", {}, {})
    assert after.quality == pytest.approx(before.quality)
    assert set(after.ages_s) == {"E", "A", "B"}


def test_nothing_of_what_was_chosen_is_said_in_the_next_cycle() -> None:
    arrivals = Arrivals()
    before = decide(arrivals)
    arrivals.take(before, cycle({"A": "deadline", "B": "refused"}))
    after = decide(arrivals)
    assert after.blind == "nothing of what was chosen has arrived for 1 cycle (deadline, refused)"
    assert after.blind in after.reason
    assert after.silent == {
        "A": "nothing of it has arrived for 1 cycle (deadline)",
        "B": "nothing of it has arrived for 1 cycle (refused)",
    }
    assert after.quality < before.quality
    arrivals.take(after, cycle({"B": "deadline"}, A=1))
    last = decide(arrivals)
    assert last.blind == ""
    assert last.silent == {"B": "nothing of it has arrived for 2 cycles (deadline)"}


def test_a_machine_that_fuses_no_frame_gets_nothing_either() -> None:
    arrivals = Arrivals()
    arrivals.take(decide(arrivals), Tally())
    after = decide(arrivals)
    assert after.blind.endswith("has arrived for 1 cycle (no frame was fused)")
    assert after.silent == {}


def test_an_ego_that_hears_nobody_says_so_and_claims_no_quality() -> None:
    decision = decide(Arrivals(), EGO, view("A", 15.0, beacon_age_s=4.0))
    assert "none of 1 living robots can be relied on" in decision.blind
    assert decision.quality == 0.0
    assert "4.0 s old" in decision.excluded["A"]
    assert decision.valid


def test_an_ego_without_its_own_robot_is_not_valid_and_blind() -> None:
    decision = decide(Arrivals(), view("E", beacon_age_s=5.0), NEAR)
    assert not decision.valid
    assert decision.blind.startswith("the ego does not see: its beacon is 5.0 s old")
    assert decision.quality == 0.0


def test_an_ego_that_chose_nobody_is_alone_and_not_blind() -> None:
    arrivals = Arrivals()
    alone = decide(arrivals, EGO)
    arrivals.take(alone, cycle({}))
    assert decide(arrivals, EGO).blind == ""


def test_a_robot_that_is_not_chosen_any_more_is_not_silent() -> None:
    arrivals = Arrivals()
    arrivals.take(decide(arrivals), cycle({"A": "deadline"}, B=5))
    arrivals.take(decide(arrivals, EGO, FAR), cycle({}, B=5))
    assert decide(arrivals).silent == {}


def test_no_more_robots_are_told_of_than_a_message_may_name() -> None:
    doubts = {f"R{number:03}": "it says to stand where R000 stands" for number in range(300)}
    assert [*bounded(doubts)] == [f"R{number:03}" for number in range(MAX_NAMED)]
