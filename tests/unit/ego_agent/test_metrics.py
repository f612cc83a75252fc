"""What an ego shows to Prometheus of its links and its demand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from ego_agent.agent import EgoAgent
from ego_agent.metrics import EgoMetrics
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.plan.control_budget import Wish
from swarm.log import make_logger
from swarm.messages import Decision
from swarm.process import Clock
from tests.support.ego_scenes import candidate, knowledge, scene, snapshot, view


def shown(registry: CollectorRegistry) -> dict[str, float]:
    lines = generate_latest(registry).decode().splitlines()
    samples = (line.rsplit(" ", 1) for line in lines if not line.startswith("#"))
    return {name: float(value) for name, value in samples}


def test_each_robot_is_shown_with_what_it_can_deliver_as_long_as_it_is_known() -> None:
    registry = CollectorRegistry()
    metrics = EgoMetrics(registry)
    metrics.links(snapshot(view("E"), view("A"), view("B", capacity_bps=1e6), capacity_bps=5e6))
    assert shown(registry)['coadapt_ego_robot_capacity_bps{robot="A"}'] == 5e6
    assert shown(registry)['coadapt_ego_robot_capacity_bps{robot="B"}'] == 1e6
    assert 'coadapt_ego_robot_capacity_bps{robot="E"}' not in shown(registry)
    metrics.links(snapshot(view("E"), view("A"), capacity_bps=4e6))
    assert shown(registry)['coadapt_ego_robot_capacity_bps{robot="A"}'] == 4e6
    assert 'coadapt_ego_robot_capacity_bps{robot="B"}' not in shown(registry)


def test_a_robot_that_left_is_shown_as_gone_until_it_is_forgotten() -> None:
    registry = CollectorRegistry()
    metrics = EgoMetrics(registry)
    metrics.links(snapshot(view("E"), view("A"), view("B", alive=False)))
    assert shown(registry)['coadapt_ego_robot_alive{robot="A"}'] == 1
    assert shown(registry)['coadapt_ego_robot_alive{robot="B"}'] == 0
    metrics.links(snapshot(view("E"), view("A")))
    assert 'coadapt_ego_robot_alive{robot="B"}' not in shown(registry)


@pytest.mark.parametrize(("source", "known"), [("prior", 0), ("net/state", 1), ("measured", 1)])
def test_an_assumed_capacity_is_told_from_a_known_one(source: str, known: int) -> None:
    registry = CollectorRegistry()
    EgoMetrics(registry).links(replace(snapshot(view("E")), capacity_source=source))
    assert shown(registry)["coadapt_ego_capacity_known"] == known


@pytest.mark.stumble(
    "C(t)'s error is not a number", command="curl -s localhost:9102/metrics | grep estimate"
)
def test_the_error_of_the_estimate_is_a_number_and_says_whether_it_is_one_of_a_measurement() -> (
    None
):
    registry = CollectorRegistry()
    metrics = EgoMetrics(registry)
    names = ("coadapt_link_estimate_error_ratio", "coadapt_link_estimate_compared")
    assert [shown(registry)[name] for name in names] == [0, 0]
    metrics.links(replace(snapshot(view("E")), capacity_error=-0.04))
    assert [shown(registry)[name] for name in names] == [-0.04, 1]
    metrics.links(snapshot(view("E")))
    assert [shown(registry)[name] for name in names] == [0, 0]


def test_what_may_come_of_a_robot_is_counted_from_zero() -> None:
    registry = CollectorRegistry()
    metrics = EgoMetrics(registry)
    metrics.decides_among(("early", "late"))
    metrics.links(snapshot(view("E"), view("A")))
    found = shown(registry)
    assert found['coadapt_ego_decisions_total{algorithm="late",source="fallback"}'] == 0
    assert found['coadapt_ego_received_bytes_total{algorithm="early",robot="A"}'] == 0
    assert found['coadapt_ego_missing_total{reason="deadline",robot="A"}'] == 0


def test_a_demand_that_cannot_be_told_costs_the_cycle_nothing() -> None:
    registry = CollectorRegistry()
    unused = cast("Any", None)
    agent = EgoAgent(
        monitor=Monitor("E", LinkEstimate(55e6)),
        knowledge=knowledge(),
        steering=unused,
        sensor=unused,
        fusion=unused,
        tally=unused,
        journal=None,
        metrics=EgoMetrics(registry),
        clock=Clock(),
        log=make_logger("test", level="critical"),
        usual_body=unused,
    )
    decision = Decision(
        ego="E",
        cycle=1,
        decided_ns=1,
        participants=("E",),
        algorithm="early",
        reason="",
        source="policy",
        policy="coverage",
        valid=True,
    )
    failed = 'coadapt_ego_publish_failures_total{message="demand"}'
    seen, wish = snapshot(view("E")), Wish(0, {})
    told = agent._say_demand(seen, scene(candidate("E", [1])), decision, wish)
    assert told is not None  # no router
    assert shown(registry)[failed] == 1
    assert agent._say_demand(seen, cast("Any", "no scene"), decision, wish) is None
    assert shown(registry)[failed] == 2
    assert agent._say_demand(seen, None, decision, wish) is None
