"""Robots of whom nothing new is heard are asked for one frame, one after the other, ever rarer."""

from __future__ import annotations

import itertools
from dataclasses import replace

import msgspec
import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import RobotView
from ego_agent.plan.decision import alone
from ego_agent.plan.intents.bind import bound_objective
from ego_agent.plan.intents.combine import Standing, standing
from ego_agent.plan.unheard import FIRST_S, FORGET_S, LAST_S, UnheardProber
from swarm.messages import Intent, IntentInForce, Probe
from tests.support.ego_scenes import snapshot, view

KNOWLEDGE = Knowledge()
NOTHING_WISHED = Standing()
OLD_S = KNOWLEDGE.objective.beacon_max_age_s + 0.1


def old(robot: str, x: float = 5.0) -> RobotView:
    return replace(view(robot, x, beacon_age_s=OLD_S), unheard_s=OLD_S)


def asked(
    prober: UnheardProber,
    *others: RobotView,
    at_s: float = 0.0,
    chosen: tuple[str, ...] = (),
    capacity_bps: float = 100e3,
    wishes: Standing = NOTHING_WISHED,
) -> Probe | None:
    now = snapshot(view("E"), *others, capacity_bps=capacity_bps)
    decision = alone(now, KNOWLEDGE, "coverage", "nobody is heard")
    decision = msgspec.structs.replace(decision, participants=("E", *chosen))
    # As the cycle's knowledge is, which aims at what is wished.
    aiming = KNOWLEDGE.aiming_at(bound_objective(KNOWLEDGE.objective, wishes))
    return prober.take(now, aiming, decision, wishes, at_s)


def test_the_nearest_is_asked_first_for_its_smallest_observation_and_then_the_next() -> None:
    prober = UnheardProber()
    others = old("R1", 9.0), old("R2", 3.0)
    assert asked(prober, *others) == Probe(robot="R2", algorithm="late", bytes=600)
    assert asked(prober, *others, at_s=0.5) == Probe(robot="R1", algorithm="late", bytes=600)
    assert asked(prober, *others, at_s=0.6) is None


def test_who_does_not_come_back_is_asked_ever_more_rarely_until_it_is_chosen() -> None:
    prober, now_s, times = UnheardProber(), 0.0, []
    while now_s < 400.0:
        if asked(prober, old("R1"), at_s=now_s):
            times.append(now_s)
        now_s += 0.5
    waits = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert waits[:4] == [FIRST_S, 2 * FIRST_S, 4 * FIRST_S, 8 * FIRST_S]
    assert max(waits) == LAST_S
    assert asked(prober, old("R1"), at_s=times[-1] + FIRST_S) is None
    assert asked(prober, old("R1"), at_s=times[-1] + FIRST_S, chosen=("R1",)) is not None


def test_after_a_long_time_it_is_asked_as_at_first() -> None:
    prober = UnheardProber()
    for at_s in (0.0, 1.0, 3.0):
        assert asked(prober, old("R1"), at_s=at_s)
    later_s = 3.0 + FORGET_S + 0.1
    assert asked(prober, old("R1"), at_s=later_s)
    assert asked(prober, old("R1"), at_s=later_s + FIRST_S)


@pytest.mark.parametrize(
    "robot",
    [
        view("R1", 5.0),
        replace(old("R1"), alive=False),
        replace(old("R1"), duplicate=True),
        replace(old("R1"), misfit="it is in another world"),
        old("R1", KNOWLEDGE.objective.comm_range_m + 1.0),
        view("R1", 5.0, beacon=False),
        replace(view("R1", 5.0, beacon_age_s=OLD_S, sizes={}), unheard_s=OLD_S),
        replace(view("R1", 5.0), unheard_s=OLD_S),
    ],
    ids=["heard", "left", "twice", "misfit", "far", "unknown", "no size", "answers"],
)
def test_nobody_is_asked_who_is_heard_or_is_out_for_another_reason(robot: RobotView) -> None:
    assert asked(UnheardProber(), robot) is None


def test_nobody_is_asked_while_beacons_of_others_come_quickly() -> None:
    assert asked(UnheardProber(), old("R1"), view("R2", 30.0)) is None


def test_nobody_is_asked_where_the_link_does_not_carry_the_answer_in_a_second() -> None:
    narrow_bps = 8.0 * 600 / KNOWLEDGE.objective.headroom
    assert asked(UnheardProber(), old("R1"), capacity_bps=narrow_bps - 1.0) is None
    assert asked(UnheardProber(), old("R1"), capacity_bps=narrow_bps + 1.0)


@pytest.mark.parametrize(
    "intent", [Intent(exclude=("R1",)), Intent(only=("R2",)), Intent(link_share=0.01)]
)
def test_whom_an_operator_leaves_out_is_left_alone(intent: Intent) -> None:
    wishes = standing([IntentInForce(number=1, intent=intent, operator="ann")])
    assert asked(UnheardProber(), old("R1"), wishes=wishes) is None


def test_an_ego_that_does_not_know_where_it_is_asks_nobody() -> None:
    now = snapshot(view("E", beacon=False), old("R1"))
    decision = alone(now, KNOWLEDGE, "coverage", "")
    assert UnheardProber().take(now, KNOWLEDGE, decision, NOTHING_WISHED, 0.0) is None
