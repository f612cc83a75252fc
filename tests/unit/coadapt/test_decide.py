from __future__ import annotations

import io
import json
from typing import Any

import msgspec
import pytest

from coadapt.main import main
from swarm.messages import Decision
from tests.support.paths import REPOSITORY

EXAMPLE = REPOSITORY / "docs" / "example-scene.json"


@pytest.fixture
def example() -> Any:
    return json.loads(EXAMPLE.read_text())


def feed(monkeypatch: pytest.MonkeyPatch, document: bytes) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(document)))


def test_a_scene_on_standard_input_gives_one_decision(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    feed(monkeypatch, EXAMPLE.read_bytes())
    assert main(["decide", "--policy", "coverage"]) == 0
    out = capsys.readouterr().out
    decision = msgspec.json.decode(out, type=Decision)
    assert out.count("\n") == 1
    assert decision.participants == ("R1", "R4", "R3")  # R2 stands beside R1 and sees the same
    assert decision.algorithm == "early"
    assert decision.policy == "coverage"
    assert decision.cost_bytes == 23_100


@pytest.mark.parametrize(
    ("policy", "participants", "algorithm"),
    [
        ("static-early", ["R1", "R2", "R4", "R3"], "early"),
        ("static-late", ["R1", "R2", "R4", "R3"], "late"),
        ("rules", ["R1", "R2", "R4", "R3"], "late"),
    ],
)
def test_every_policy_decides_on_a_scene_file(
    policy: str,
    participants: list[str],
    algorithm: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["decide", str(EXAMPLE), "--policy", policy]) == 0
    decision = json.loads(capsys.readouterr().out)
    assert (decision["participants"], decision["algorithm"]) == (participants, algorithm)


def test_explain_tells_what_each_robot_offers_and_who_is_left_out(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["decide", str(EXAMPLE), "--explain"]) == 0
    explanation = json.loads(capsys.readouterr().out)["explanation"]
    assert explanation["budget_bytes"] == 50_000
    offers = {c["robot"]: c["adds_to_ego"] for c in explanation["candidates"]}
    assert list(offers) == ["R2", "R4", "R3"]
    assert offers["R2"] < offers["R4"] < offers["R3"]
    parts = {c["robot"]: c for c in explanation["candidates"]}
    assert not parts["R2"]["chosen"]
    assert parts["R2"]["adds"] < parts["R2"]["costs"]
    assert parts["R2"]["why"].startswith("out: it adds 0.0")
    assert parts["R3"]["chosen"]
    assert parts["R3"]["adds"] > parts["R3"]["costs"] > 0
    assert parts["R3"]["why"].startswith("in: it adds 0.")
    assert "61.8 m away" in explanation["excluded"]["R5"]
    assert "3.2 s old" in explanation["excluded"]["R6"]


def test_answers_that_came_late_change_the_decision_and_are_told_robot_by_robot(
    example: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example["robots"]["R3"]["answers_s"] = {"early": [0.8] * 9 + [None], "late": [0.1] * 10}
    example["robots"]["R4"]["answers_s"] = {"early": [0.1] * 10}
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide", "--explain"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["algorithm"], "R3" in report["participants"]) == ("late", True)
    assert report["arrival"]["R3"] == 1.0
    assert "R3 arrives in time in 4 % of early, 100 % of late" in report["reason"]
    answers = {c["robot"]: c["answers"] for c in report["explanation"]["candidates"]}["R3"]
    assert answers["early"]["in_time"]["10"] < 0.2
    assert answers["early"]["lost"] == pytest.approx(0.1)
    assert answers["late"]["in_time"]["10"] == 1.0


def test_answers_with_an_unknown_algorithm_are_refused(
    example: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example["robots"]["R3"]["answers_s"] = {"psychic": [0.1]}
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide"]) == 1
    assert "robot R3: answers_s: algorithm 'psychic' is unknown" in capsys.readouterr().err


def test_objective_algorithms_and_previous_decision_come_from_the_scene(
    example: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example["algorithms"] = ["late"]
    example["objective"] = {"lambda_cost": 1e6, "q_min": 0}
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide"]) == 0
    assert json.loads(capsys.readouterr().out)["participants"] == ["R1"]
    example["objective"] = {"switch_gain": 1}
    example["previous"] = {"participants": ["R1", "R2", "R3"], "algorithm": "late"}
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide"]) == 0
    assert json.loads(capsys.readouterr().out)["participants"] == ["R1", "R2", "R3"]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["capacity_bps"], -1, ">= 1.0 - at `$.capacity_bps`"),
        (["capacity_bps"], "fast", "Expected `float`, got `str` - at `$.capacity_bps`"),
        (["ego"], "R9", "ego 'R9' is not one of the robots: R1, R2"),
        (["ego"], "R 1", "at `$.ego`"),
        (["robots", "R2", "pose"], [1, 2], "robot R2: Expected `array` of length 6 - at `$.pose`"),
        (
            ["robots", "R2", "beacon_age_s"],
            -3,
            "robot R2: Expected `float` >= 0.0 - at `$.beacon_age_s`",
        ),
        (
            ["robots", "R2", "sizes"],
            {"voxels": 3},
            "robot R2: sizes: algorithm 'voxels' is unknown; allo",
        ),
        (["robots", "R2", "speed"], 3, "robot R2: Object contains unknown field `speed`"),
        (["objective"], {"q_min": 2}, "<= 1.0 - at `$.objective.q_min`"),
        (["algorithms"], [], "no algorithm is available"),
        (["detector"], "sonar", "detector 'sonar' has no quality model; allowed: factory, road"),
        (["algorithms"], ["magic"], "algorithms: algorithm 'magic' is unknown; allowed: early, in"),
    ],
)
def test_a_fault_in_the_scene_is_named_with_its_place(
    path: list[str],
    value: Any,
    message: str,
    example: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    *parents, leaf = path
    place = example
    for key in parents:
        place = place[key]
    place[leaf] = value
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide"]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert message in shown.err
    assert shown.err.startswith("coadapt: ")


@pytest.mark.parametrize("document", [b"", b"[1]", b'{"ego": "\xff"}', b"{", b'{"ego": NaN}'])
def test_what_is_no_scene_is_refused(
    document: bytes, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    feed(monkeypatch, document)
    assert main(["decide"]) == 1
    assert "the scene is not valid" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--policy", "guess"],
            "policy 'guess' is unknown; allowed: coverage, llm, random, rules, static-",
        ),
        (["--policy", "static-early"], "needs early fusion, which is not available"),
        (["nowhere.json"], "'nowhere.json' cannot be read: No such file"),
    ],
)
def test_a_policy_or_file_that_cannot_be_used_is_named(
    arguments: list[str],
    message: str,
    example: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    example["algorithms"] = ["late"]
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide", *arguments]) == 1
    assert message in capsys.readouterr().err


def test_a_robots_own_link_counts(
    example: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example["robots"]["R4"]["capacity_bps"] = 500_000
    feed(monkeypatch, json.dumps(example).encode())
    assert main(["decide", "--policy", "static-early"]) == 0
    decision = json.loads(capsys.readouterr().out)
    assert decision["algorithm"] == "late" or "R4" not in decision["participants"]
    assert any("its own link may carry 0.40" in repair for repair in decision["repairs"])
