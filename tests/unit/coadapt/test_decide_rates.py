"""Scene files may let single robots send less often."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest

from coadapt.main import main
from tests.support.paths import REPOSITORY

EXAMPLE = REPOSITORY / "docs" / "example-scene.json"


def decided(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *flags: str,
    **objective: Any,
) -> Any:
    """What is decided on the example at 1 Mbit/s."""
    scene = json.loads(EXAMPLE.read_text()) | {"capacity_bps": 1e6}
    scene["objective"] |= objective
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(json.dumps(scene).encode())))
    assert main(["decide", *flags]) == 0
    return json.loads(capsys.readouterr().out)


def test_rates_are_assigned_where_the_scene_names_rarer_ones(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = decided(monkeypatch, capsys)
    assert (usual["participants"], usual["assignments"]) == (["R1", "R3"], [])
    rarer = decided(monkeypatch, capsys, rarer_hz=[5, 2, 1, 0.5])
    assert {(one["robot"], one["algorithm"], one["rate_hz"]) for one in rarer["assignments"]} == {
        ("R3", "early", 2.0),
        ("R4", "early", 2.0),
    }
    assert "2 of 2 send 2 times a second" in rarer["reason"]
    asked = decided(monkeypatch, capsys, rarer_hz=[5, 2, 1, 0.5], places_hz=10)
    sent = {(one["robot"], one["rate_hz"], one["places_hz"]) for one in asked["assignments"]}
    assert sent == {("R3", 2.0, 10.0), ("R4", 1.0, 5.0)}
    assert "1 of 2 send once a second, and 5 to 10 times a second in between" in asked["reason"]


def test_an_explanation_tells_who_sends_objects_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = decided(monkeypatch, capsys, "--explain", rarer_hz=[5, 2, 1, 0.5], places_hz=10)
    of_objects = {one["robot"] for one in asked["assignments"] if one.get("objects_only")}
    told = {one["robot"]: one for one in asked["explanation"]["candidates"]}
    assert of_objects == {"R3"}
    assert told["R3"]["why"].startswith("in: early, objects only, 2 times a second adds")
    assert told["R4"]["why"].startswith("in: early 1 times a second adds")
    for one in told.values():
        assert one["objects_sizes"].keys() == {"early"}
        assert 0 < one["objects_sizes"]["early"] < one["sizes"]["early"]
