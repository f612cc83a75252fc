"""net/demand: what an ego says it needs makes Q_min feasible; it asks only for what helps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.decision import plan
from ego_agent.plan.demand import ROUNDING, SETTLED_S, DemandMeter, need
from ego_agent.plan.policies.coverage import Coverage
from swarm.messages import Decision, NetDemand, decode, encode
from tests.support.ego_scenes import NOW_NS, candidate, knowledge, scene, snapshot

# Q_min 0.95 takes early fusion with A and B: 24 kB a frame, 1.92 Mbit/s and headroom.
FLOOR = scene(
    candidate("E", range(20)), candidate("A", range(20, 40)), candidate("B", range(40, 64))
)
NARROW = replace(FLOOR, capacity_bps=1e6)


def decide(found: UnifiedScene, known: Knowledge) -> Decision:
    return plan(snapshot(), found, Coverage(), known, None, 7, NOW_NS)


def say(
    found: UnifiedScene, known: Knowledge, now_s: float = 0.0, meter: DemandMeter | None = None
) -> NetDemand:
    meter = meter or DemandMeter()
    said = meter.take(found, known, decide(found, known), sent_ns=5, now_s=now_s)
    assert decode(encode(said), NetDemand) == said
    return said


def test_the_cheapest_decision_that_reaches_q_min_is_asked_for_with_headroom() -> None:
    said = say(NARROW, knowledge(q_min=0.95, headroom=0.8))
    assert said.needed_bytes_s == 24_000 * 10 / 0.8
    assert said.possible
    assert not said.reachable
    assert (said.ego, said.cycle, said.sent_ns) == ("E", 7, 5)
    assert (said.q_min, said.capacity_bps) == (0.95, 1_000_000)
    assert said.quality < 0.95


def test_boxes_are_asked_for_where_they_suffice() -> None:
    assert say(NARROW, knowledge(q_min=0.8)).needed_bytes_s == 1_200 * 10 / 0.8


def test_an_ego_that_reaches_q_min_alone_needs_nothing() -> None:
    said = say(NARROW, knowledge(q_min=0.3))
    assert (said.needed_bytes_s, said.possible, said.reachable) == (0, True, True)


def test_what_no_link_could_bring_is_not_asked_for() -> None:
    late_only = knowledge(("late",), q_min=0.95)
    said = say(NARROW, late_only)
    assert (said.needed_bytes_s, said.possible, said.reachable) == (0, False, False)
    assert said.unreachable_s == 0.0


def test_a_wider_cell_is_not_asked_for_where_a_robots_own_link_is_the_limit() -> None:
    behind = replace(FLOOR.candidates[1], capacity_bps=5e5)
    found = replace(NARROW, candidates=(FLOOR.candidates[0], behind))
    said = say(found, knowledge(q_min=0.95))
    assert (said.needed_bytes_s, said.possible) == (0, False)


def test_the_time_below_q_min_counts_until_it_is_reached() -> None:
    known, meter = knowledge(q_min=0.95), DemandMeter()
    assert [say(NARROW, known, t, meter).unreachable_s for t in (10.0, 11.0, 15.5)] == [0, 1, 5.5]
    good = [say(FLOOR, known, t, meter).unreachable_s for t in (16.0, 16.0 + SETTLED_S)]
    assert good == [0, 0]
    assert [say(NARROW, known, t, meter).unreachable_s for t in (27.0, 28.0)] == [0, 1]


def test_a_link_that_is_good_for_a_moment_only_does_not_start_the_time_anew() -> None:
    known, meter = knowledge(q_min=0.95), DemandMeter()
    say(NARROW, known, 10.0, meter)
    assert say(FLOOR, known, 12.0, meter).unreachable_s == 0
    assert say(NARROW, known, 13.0, meter).unreachable_s == 3.0


def test_the_time_counts_while_living_robots_are_not_heard() -> None:
    known, meter = knowledge(q_min=0.95), DemandMeter()
    deaf = replace(NARROW, candidates=(), unknown=2)
    said = [say(deaf, known, t, meter) for t in (10.0, 14.0)]
    assert [one.unreachable_s for one in said] == [0, 4]
    assert not any(one.possible or one.reachable for one in said)


def test_the_time_does_not_count_while_no_link_could_help() -> None:
    known, meter = knowledge(q_min=0.97), DemandMeter()
    say(NARROW, known, 10.0, meter)
    alone = replace(NARROW, candidates=(FLOOR.candidates[0],), capacity_bps=1e6)
    blind = replace(alone, candidates=(replace(FLOOR.candidates[0], sizes={"late": 600}),))
    assert say(blind, known, 12.0, meter).unreachable_s == 0
    assert say(NARROW, known, 13.0, meter).unreachable_s == 0


def test_a_decision_that_reaches_q_min_shows_that_it_is_reachable() -> None:
    known = knowledge(q_min=0.95)
    better = Decision(
        ego="E",
        cycle=1,
        decided_ns=1,
        participants=("E", "A"),
        algorithm="early",
        reason="",
        source="llm",
        policy="x",
        valid=True,
        quality=0.96,
    )
    said = DemandMeter().take(NARROW, known, better, sent_ns=1, now_s=0.0)
    assert said.reachable
    assert said.unreachable_s == 0.0


@st.composite
def scenes(draw: st.DrawFn) -> UnifiedScene:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    robots = [
        candidate(
            name,
            np.flatnonzero(rng.random(64) < rng.uniform(0.02, 0.4)).tolist(),
            rng.uniform(0, 1, 4).tolist(),
            sizes={
                "early": int(rng.integers(5_000, 30_000)),
                "late": int(rng.integers(200, 2_000)),
            },
        )
        for name in ("E", "A", "B", "C", "D")[: draw(st.integers(1, 5))]
    ]
    return scene(*robots, capacity_bps=draw(st.floats(1e3, 2e7)))


@settings(max_examples=200, deadline=None)
@given(
    scenes(), st.sampled_from([0.0, 0.5, 0.7, 0.85, 0.95, 1.0]), st.floats(0.1, 1), st.floats(1, 30)
)
def test_a_link_of_what_is_needed_is_one_on_which_q_min_is_reached(
    found: UnifiedScene, q_min: float, headroom: float, rate_hz: float
) -> None:
    known = knowledge(q_min=q_min, headroom=headroom, rate_hz=rate_hz)
    wanted = need(found, known)
    if decide(found, known).quality >= q_min - ROUNDING:
        assert wanted.possible
    if wanted.possible:
        enough = replace(found, capacity_bps=max(1.0, 8.0 * wanted.bytes_s))
        assert decide(enough, known).quality >= q_min - ROUNDING
        assert need(enough, known).fits
        assert need(enough, known).bytes_s == wanted.bytes_s
    else:
        assert wanted.bytes_s == 0
        assert decide(replace(found, capacity_bps=1e12), known).quality < q_min


@pytest.mark.parametrize("capacity_bps", [1.0, 1e3, 1e12])
def test_any_capacity_can_be_told(capacity_bps: float) -> None:
    said = say(replace(FLOOR, capacity_bps=capacity_bps), knowledge(q_min=0.95))
    assert said.capacity_bps == capacity_bps
