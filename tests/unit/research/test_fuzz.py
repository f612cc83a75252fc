"""The fuzzer finds planted faults, and its targets take their corpus."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from research.fuzz.__main__ import CORPUS, main
from research.fuzz.hunt import hunt
from research.fuzz.target import load
from research.fuzz.targets import TARGETS
from research.fuzz.trial import fault, try_out
from research.fuzz.values import changed

PLANTED = "tests.support.planted_targets"


@pytest.mark.parametrize("name", TARGETS)
# Of NumPy, about headers that it has to read twice, and of text without numbers.
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_target_takes_its_corpus(name: str) -> None:
    target = load(TARGETS[name])
    files = sorted((CORPUS / name).iterdir())
    assert files
    assert [(path.name, said) for path in files if (said := fault(target, path.read_bytes()))] == []
    assert [path.name for path in files if path.stat().st_size > target.max_bytes] == []


def test_every_folder_of_the_corpus_is_a_target() -> None:
    assert {path.name for path in CORPUS.iterdir()} == TARGETS.keys()


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_each_target_reads_something_to_its_end(name: str) -> None:
    target = load(TARGETS[name])

    def read(data: bytes) -> bool:
        try:
            target.take(data)
        except target.errors:
            return False
        return True

    assert any(read(path.read_bytes()) for path in (CORPUS / name).iterdir())


@pytest.mark.parametrize(
    ("name", "data", "kind", "words"),
    [
        ("CRASH", b"BUG", "crash", "KeyError"),
        ("HANG", b"H", "hang", "of the processor"),
        ("ENDLESS", b"E", "hang", "did not end"),
        ("JUMP", b"J", "jump", "MB"),
        ("DIE", b"D", "crash", "the process ended"),
    ],
)
def test_an_input_alone_is_found_out(
    tmp_path: Path, name: str, data: bytes, kind: str, words: str
) -> None:
    path = tmp_path / "input"
    path.write_bytes(data)
    found = try_out(f"{PLANTED}:{name}", path)
    assert found is not None
    assert found.kind == kind
    assert words in found.what


@pytest.mark.parametrize(("name", "data"), [("CRASH", b"V"), ("HANG", b""), ("JUMP", b"x")])
def test_what_a_target_allows_is_no_finding(tmp_path: Path, name: str, data: bytes) -> None:
    path = tmp_path / "input"
    path.write_bytes(data)
    assert try_out(f"{PLANTED}:{name}", path) is None


@pytest.mark.slow
def test_coverage_leads_to_a_planted_fault(tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="atheris has no wheel for this Python")
    found = hunt(
        "planted", f"{PLANTED}:CRASH", 600, seed=1, seeds=tmp_path, build=tmp_path, runs=300_000
    )
    assert found.row()["crashes"] >= 1
    for path, finding in found.findings.items():
        assert Path(path).read_bytes()[:2] == b"BU"
        assert "KeyError at planted_targets.py" in finding.what
    assert found.executions > 100


def test_a_seed_that_kills_or_swells_the_worker_is_found(tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="atheris has no wheel for this Python")
    for name, data, kind in (("DIE", b"D", "crash"), ("JUMP", b"J", "jump")):
        seeds = tmp_path / name
        seeds.mkdir()
        (seeds / "guilty").write_bytes(data)
        found = hunt(name, f"{PLANTED}:{name}", 600, seed=1, seeds=seeds, build=tmp_path, runs=10)
        assert found.count(kind) >= 1, (name, found)


@pytest.mark.slow
def test_the_command_tells_what_it_found_and_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("atheris", reason="atheris has no wheel for this Python")
    place = f"{PLANTED}:HANG"
    grown = tmp_path / "fuzz" / "corpus" / place
    grown.mkdir(parents=True)
    (grown / "guilty").write_bytes(b"H")
    assert main(["--target", place, "--seconds", "5", "--build", str(tmp_path)]) == 1
    result = json.loads((tmp_path / "fuzz.json").read_text())
    assert (result["crashes"], result["hangs"], result["jumps"]) == (0, 1, 0)
    assert "hang: it took" in capsys.readouterr().err


def test_a_target_that_is_unknown_is_told_with_those_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("atheris", reason="atheris has no wheel for this Python")
    with pytest.raises(SystemExit):
        main(["--target", "pionts", "--build", str(tmp_path)])
    assert "'pionts' is unknown; allowed: answers, arrays" in capsys.readouterr().err


def test_values_of_json_are_changed_and_its_form_is_kept() -> None:
    text = json.dumps({"a": [1, 2.5, {"b": "c"}], "d": None}).encode()
    made = [changed(b"\1" + text, 1, random.Random(seed)) for seed in range(200)]
    trees = [json.loads(one[1:]) for one in made if one is not None]
    assert len(trees) == 200
    assert len({json.dumps(tree) for tree in trees}) > 50
    assert all(isinstance(tree, dict) for tree in trees)
    assert changed(b"\1{", 1, random.Random(0)) is None
