"""The model of compute: what stands in for what was not measured, and files that are no model."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ego_agent.knowledge.compute import SINGLE, Work, packaged_compute, read_compute
from perception.fusion.algorithms import all_fusions
from research.benchmarks.compute import work_of
from swarm.errors import DecisionError

WORK = {"encode_ms": 8.0, "fixed_ms": 20.0, "add_ms": 4.0}
MODEL = {
    "machine": "a processor",
    "detectors": {"factory": {"intermediate": WORK, "single": {**WORK, "fixed_ms": 19.0}}},
    "samples": {},
}


def written(folder: Path, model: object) -> Path:
    path = folder / "compute.json"
    path.write_text(json.dumps(model))
    return path


def test_the_packaged_model_knows_every_algorithm_of_both_detectors() -> None:
    model = packaged_compute()
    assert model.machine
    for detector in ("factory", "road"):
        assert set(model.detectors[detector]) == {SINGLE, *all_fusions()}
        alone = model.work(detector, SINGLE)
        assert alone.encode_ms == alone.add_ms == 0 < alone.fixed_ms
        assert all(model.work(detector, name).encode_ms > 0 for name in all_fusions())


def test_what_was_not_measured_costs_what_is_usual(tmp_path: Path) -> None:
    model = read_compute(written(tmp_path, MODEL))
    assert model.work("factory", "new") == Work(8.0, 20.0, 4.0)
    assert model.work("sea", SINGLE).fixed_ms == 19.0
    assert model.work("sea", "new").ego_ms(3) == 32.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"machine": 3}, r"compute.json is no model of compute: .*\$.machine"),
        ({"detectors": {}}, "has the detectors none; needed: factory"),
        ({"detectors": {"factory": {"late": WORK}}}, "has the algorithms late; needed: interm"),
        ({"detectors": {"factory": {"late": {**WORK, "add_ms": -1}}}}, "add_ms|>= 0"),
    ],
)
def test_a_file_that_is_no_model_is_named(
    change: dict[str, object], words: str, tmp_path: Path
) -> None:
    with pytest.raises(DecisionError, match=words):
        read_compute(written(tmp_path, {**MODEL, **change}))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DecisionError, match=r"nowhere\.json is no model of compute"):
        read_compute(tmp_path / "nowhere.json")


def test_a_line_through_few_and_many_contributions() -> None:
    times = {"encode": [7.0, 8.0, 9.0], "few": [30.0, 24.0, 25.0], "all": [38.0, 40.0, 33.0]}
    assert work_of(times) == Work(8.0, 23.0, 2.0)
    assert work_of({"few": [19.0]}) == Work(0.0, 19.0, 0.0)
