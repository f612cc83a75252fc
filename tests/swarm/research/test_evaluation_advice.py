"""Language models in `coadapt eval policies`: asked once a prompt, never worse than coverage."""

from __future__ import annotations

import asyncio
import csv
import json
from asyncio import StreamReader, StreamWriter
from collections.abc import Iterator
from pathlib import Path

import pytest

from coadapt.main import main
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.settings import EgoSettings
from llm_gateway.backends.llamacpp.models import INSTALL, installed_models, runtime_installed
from perception.fusion.registry import fusion_names
from research.evaluation.policies.advice import AdvisedAtOnce, Model
from research.evaluation.policies.decide import Decided, decisions
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.result_store import ResultStore
from research.evaluation.windows import announcements, links
from research.evaluation.windows.announcements import Announced
from research.evaluation.windows.measure import Window
from research.evaluation.windows.scenarios import Scenario, factory_suite
from research.training.plans import TEST_SEEDS
from swarm.errors import CoAdaptError
from tests.support.model_server import ModelServer, Request, says, serving_model, status

SCENARIO = Scenario("advised", 4, links.shift(), TEST_SEEDS.start + 555_557, windows=2)
KNOWLEDGE = knowledge_of(fusion_names("factory"), SCENARIO)


@pytest.fixture(scope="module")
def messages() -> list[Announced]:
    window = Window(SCENARIO, 0)
    fusions = {name: window.fusion(name) for name in KNOWLEDGE.algorithms}
    return [
        announcements.heard(window.world, frame, window.ego, dict(fusions)) for frame in (0, 50)
    ]


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with serving_model() as running:
        yield running


def advice(*helpers: str, algorithm: str) -> str:
    return json.dumps(
        {
            "algorithm": algorithm,
            "helpers": helpers,
            "confidence": "high",
            "explanation": "they see the rest",
        }
    )


def decide(server: ModelServer, kept: ResultStore, messages: list[Announced]) -> list[Decided]:
    model = Model(f"test-model@{server.url}/v1", kept)
    try:
        return decisions(SCENARIO, messages, KNOWLEDGE, AdvisedAtOnce(model))
    finally:
        model.close()


def test_good_advice_is_followed_and_equal_prompts_are_asked_once(
    server: ModelServer, messages: list[Announced], tmp_path: Path
) -> None:
    fallback = decisions(SCENARIO, messages, KNOWLEDGE, Coverage())
    best = fallback[0].choice
    server.otherwise = says(advice(*best.participants, algorithm=best.algorithm))
    first = decide(server, ResultStore(tmp_path, ["swarm"]), messages)
    assert first[0].choice == best
    assert first[0].source == "llm", first[0].repairs
    assert first[0].decision_s > 0
    asked = server.asked.qsize()
    assert asked >= 1
    again = decide(server, ResultStore(tmp_path, ["swarm"]), messages)
    assert server.asked.qsize() == asked
    assert again == first, "as long as the answers took when they were made"


def test_a_model_may_be_asked_in_the_papers_manner_and_is_a_row_of_its_own(
    server: ModelServer, messages: list[Announced], tmp_path: Path
) -> None:
    best = decisions(SCENARIO, messages, KNOWLEDGE, Coverage())[0].choice
    server.otherwise = says(advice(*best.participants, algorithm=best.algorithm))
    model = Model(f"test-model@{server.url}/v1", ResultStore(tmp_path, ["swarm"]))
    try:
        policy = AdvisedAtOnce(model, "paper")
        found = decisions(SCENARIO, messages, KNOWLEDGE, policy)
    finally:
        model.close()
    request = server.next()
    assert "Robots, nearest first" in request.body["messages"][-1]["content"]
    assert found[0].source == "llm"
    assert found[0].choice == best
    assert policy.name == "llm-test-model-paper"


@pytest.mark.parametrize(
    "words", [advice("R2", algorithm="late"), advice("R9", algorithm="magic"), "I cannot say."]
)
def test_advice_that_is_no_use_leaves_what_coverage_decides(
    words: str, server: ModelServer, messages: list[Announced], tmp_path: Path
) -> None:
    server.otherwise = says(words)
    found = decide(server, ResultStore(tmp_path, ["swarm"]), messages)
    wanted = decisions(SCENARIO, messages, KNOWLEDGE, Coverage())
    assert [one.choice for one in found] == [one.choice for one in wanted]
    assert {one.source for one in found} == {"fallback"}
    assert found[0].repairs, "why is said"


def test_a_server_that_is_not_there_leaves_what_coverage_decides(
    messages: list[Announced], tmp_path: Path
) -> None:
    with serving_model() as gone:
        pass
    found = decide(gone, ResultStore(tmp_path, ["swarm"]), messages)
    assert {one.source for one in found} == {"fallback"}
    assert {one.answered for one in found} == {False}


def test_an_answer_that_did_not_come_is_asked_for_again(
    server: ModelServer, messages: list[Announced], tmp_path: Path
) -> None:
    server.otherwise = status(500, "out of order")
    assert {one.answered for one in decide(server, ResultStore(tmp_path, ["swarm"]), messages)} == {
        False
    }
    server.otherwise = says(advice("R2", algorithm="late"))
    assert {one.answered for one in decide(server, ResultStore(tmp_path, ["swarm"]), messages)} == {
        True
    }


def test_models_of_one_name_on_two_servers_are_two(
    server: ModelServer, messages: list[Announced], tmp_path: Path
) -> None:
    kept = ResultStore(tmp_path, ["swarm"])
    decide(server, kept, messages)
    with serving_model() as other:
        decide(other, kept, messages)
        assert other.asked.qsize() == server.asked.qsize() > 0


def test_a_slow_answer_is_asked_for_once_and_counts_once(
    server: ModelServer, messages: list[Announced], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "ego_agent.plan.policies.llm.EgoSettings", lambda: EgoSettings(llm_period_s=0.1)
    )

    async def slowly(reader: StreamReader, writer: StreamWriter, request: Request) -> None:
        await asyncio.sleep(0.3)
        await says(advice("R2", algorithm="late"))(reader, writer, request)

    server.otherwise = slowly
    first = decide(server, ResultStore(tmp_path, ["swarm"]), messages)
    assert server.asked.qsize() == len(messages)
    again = decide(server, ResultStore(tmp_path, ["swarm"]), messages)
    assert again == first


@pytest.mark.parametrize("spec", ["@http://127.0.0.1:1/v1", "no-such-model", "x@gopher://y"])
def test_a_model_that_cannot_work_is_named(spec: str, tmp_path: Path) -> None:
    with pytest.raises(CoAdaptError):
        Model(spec, ResultStore(tmp_path, ["swarm"]))


@pytest.mark.model
def test_a_real_model_is_a_row_of_its_own(tmp_path: Path) -> None:
    if not runtime_installed() or "smollm2-135m" not in installed_models():
        pytest.skip(f"the embedded model is not installed: {INSTALL}")
    name = next(scenario.name for scenario in factory_suite() if scenario.robots == 3)
    options = ["--scenarios", name, "--policies", "coverage", "--models", "smollm2-135m"]
    assert main(["eval", "policies", *options, "--output", str(tmp_path)]) == 0
    headline = json.loads((tmp_path / "headline.json").read_text())
    rows = {row["policy"]: row for row in headline["rows"]}
    (name,) = {one["policy"] for one in headline["controls"]} - {"coverage"}
    advised = rows[name]
    assert name.startswith("llm-")
    assert {one["control"] for one in headline["controls"] if one["policy"] == name} == {
        f"{name}~random", f"{name}~first", "random-judged",
    }  # fmt: skip
    assert advised["infeasible_ratio"] == 0
    assert advised["decision_ms_p50"] > rows["coverage"]["decision_ms_p50"]
    assert advised["answered_ratio"] == 1
    assert any(claim["what"].startswith("llm-") for claim in headline["claims"])
    with (tmp_path / "eval.csv").open() as file:
        lines = list(csv.DictReader(file))
    values = {(line["policy"], line["window"]): float(line["value"]) for line in lines}
    gained = [
        value - values["coverage", window]
        for (policy, window), value in values.items()
        if policy == advised["policy"]
    ]
    # The file's values are rounded.
    assert advised["beats_coverage_ratio"] == pytest.approx(
        sum(gain > 0 for gain in gained) / len(gained), abs=1e-5
    )
    assert rows["coverage"]["beats_coverage_ratio"] == 0
    assert "## Language models beside `coverage`" in (tmp_path / "report.md").read_text()
