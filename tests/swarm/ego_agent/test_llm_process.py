"""The real ego process with policy `llm`: what it publishes, writes and counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from ego_agent.knowledge.journal import CycleRecord, read_journal
from ego_agent.settings import load_settings
from swarm.errors import SettingError
from swarm.messages import Decision
from tests.support.ego_advice import Gateway, saying
from tests.support.ego_swarm import Swarm, factory, metrics_of, stop, swarm_of, until
from tests.support.free_ports import free_ports

EGO, OTHER = "R1", "R2"
EGO_ENV = {"ego": EGO, "comm_range_m": "500", "period_s": "0.25", "policy": "llm"}


@pytest.fixture
def swarm(tmp_path_factory: pytest.TempPathFactory, tmp_path: Path) -> Iterator[Swarm]:
    world = factory(tmp_path_factory.getbasetemp() / "scans")
    with swarm_of(world, tmp_path) as swarm:
        swarm.router()
        swarm.robot(OTHER)
        yield swarm


def counted(samples: dict[str, float], name: str, label: str) -> Counter[str]:
    """A counter's samples by their only label."""
    head = f'{name}{{{label}="'
    return Counter({k[len(head) : -2]: int(v) for k, v in samples.items() if k.startswith(head)})


def of(lines: list[CycleRecord], part: str) -> Counter[str]:
    """Outcomes of answers, or reasons why advice ended, as the journal's lines have them."""
    reports = [line.advice for line in lines if line.advice is not None]
    if part == "ended":
        return Counter(r.ended for r in reports if r.ended)
    return Counter(r.answer.outcome for r in reports if r.answer is not None)


def test_advice_is_adopted_held_lost_with_its_gateway_and_adopted_again(
    swarm: Swarm, tmp_path: Path
) -> None:
    decisions = swarm.decisions(swarm.session(), EGO)
    handler = saying(OTHER, model="tiny")
    gateway = Gateway(swarm.session(), handler)
    journal, port = tmp_path / "journal.jsonl", free_ports(1)
    ego = swarm.ego(**EGO_ENV, journal=str(journal), metrics_port=str(port))
    adopted = decisions.until(lambda d: d.source == "llm")
    assert (adopted.participants, adopted.model, adopted.policy) == ((EGO, OTHER), "tiny", "llm")
    decisions.until(lambda d: d.source == "hold")
    gateway.kill()
    gone = decisions.until(lambda d: d.advice is not None and not d.advice.gateway)
    assert (gone.source, gone.model) == ("fallback", "")
    Gateway(swarm.session(), handler)
    decisions.until(lambda d: d.source == "llm")

    # Prometheus and the journal agree while both go on: a scrape lies between two readings.
    def agree() -> bool:
        before = list(read_journal(journal))
        samples = metrics_of(port)
        if len(before) != len(list(read_journal(journal))):
            return False
        for part, name, label in (
            ("outcome", "coadapt_ego_advice_total", "outcome"),
            ("ended", "coadapt_ego_advice_ended_total", "reason"),
        ):
            if counted(samples, name, label) != of(before, part):
                return False
        return samples["coadapt_ego_gateway_alive"] == 1.0

    until(agree, "a scrape with no cycle completed meanwhile")
    assert stop(ego) == 0
    for decision in decisions.all:
        assert decision.valid
        assert decision.advice is not None
        assert decision.advice.gateway or decision.source == "fallback"
    lines = list(read_journal(journal))
    assert of(lines, "outcome")["adopted"] >= 2
    assert {line.decision.model for line in lines} == {"", "tiny"}
    answers = [line.advice.answer for line in lines if line.advice and line.advice.answer]
    came = [found for found in answers if found.source]
    assert came[0].tokens.prompt == 90
    assert all(found.latency_ms > 0 and found.model == "tiny" for found in came)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PERIOD_S", "0"),
        ("DEADLINE_S", "1000"),
        ("MIN_CONFIDENCE", "2"),
        ("VALUE_MARGIN", "-1"),
        ("JUDGE", "nobody"),
    ],
)
def test_a_wrong_setting_ends_the_process_with_its_name(name: str, value: str) -> None:
    with pytest.raises(SettingError, match=f"COADAPT_LLM_{name} = '{value}'"):
        load_settings({f"COADAPT_LLM_{name}": value})


def test_without_any_gateway_every_cycle_is_decided_by_the_fallback(swarm: Swarm) -> None:
    decisions = swarm.decisions(swarm.session(), EGO)
    swarm.ego(**EGO_ENV)

    def together(decision: Decision) -> bool:
        return OTHER in decision.participants

    decisions.until(together)
    assert all(d.source == "fallback" and d.policy == "llm" for d in decisions.all)


def test_a_gateway_without_a_model_is_asked_and_refuses(swarm: Swarm, tmp_path: Path) -> None:
    decisions = swarm.decisions(swarm.session(), EGO)
    journal = tmp_path / "journal.jsonl"
    swarm.start("llm_gateway", llm_backend="none", llm_http_port="0")
    ego = swarm.ego(**EGO_ENV, llm_period_s="0.3", journal=str(journal))
    for _ in range(2):
        decisions.until(lambda d: d.advice is not None and d.advice.answer is not None)
    assert stop(ego) == 0
    assert {d.source for d in decisions.all} == {"fallback"}
    assert set(of(list(read_journal(journal)), "outcome")) == {"unavailable"}
