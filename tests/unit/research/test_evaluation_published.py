"""`coadapt eval published`: the published files' own means, and what their link could carry."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from coadapt.main import main
from research.evaluation.published import EVAL_COLUMNS, SELECTION_COLUMNS, read_published, summary
from swarm.errors import EvaluationError
from worlds.sample import data_folder

SELECTION = {
    "scenario": "street", "frame_idx": "0", "frame_name": "000069", "ego_cav": "1",
    "com_range_m": "45.0", "bandwidth_mbps": "20", "all_cavs": "1|2|3", "in_range_cavs": "1|2|3",
    "selected_cavs": "1|2", "n_selected": "2", "fusion_method": "intermediate", "reason": "a, b",
    "llm_response_time_s": "40",
}  # fmt: skip
OUTCOME = {
    "scenario": "street", "selection_frame": "000069", "n_frames_inferred": "50",
    "fusion_method": "intermediate", "all_cavs": "1|2|3", "in_range_cavs": "1|2|3",
    "selected_cavs": "1|2", "n_selected": "2", "avg_ap_03": "0.9", "avg_ap_05": "0.8",
    "avg_ap_07": "0.7", "total_comm_bytes": "5000000", "avg_comm_bytes_per_frame": "100000",
}  # fmt: skip


def write(path: Path, columns: tuple[str, ...], rows: list[dict[str, str]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    quoted = [[f'"{row[name]}"' for name in columns if name in row] for row in rows]
    path.write_text("\n".join([",".join(columns), *map(",".join, quoted)]) + "\n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A model's two cycles: one leaves a vehicle out, the other takes all and more than the link
    carries."""
    split = tmp_path / "model" / "test"
    late = {"frame_name": "000169", "bandwidth_mbps": "5"}
    write(split / "selection.csv", SELECTION_COLUMNS, [SELECTION, SELECTION | late])
    second = {"selection_frame": "000169"}
    write(split / "eval.csv", EVAL_COLUMNS, [OUTCOME, OUTCOME | second])
    everyone = {"n_selected": "3", "avg_comm_bytes_per_frame": "300000", "avg_ap_07": "0.75"}
    write(split / "eval_baseline.csv", EVAL_COLUMNS, [OUTCOME | everyone, OUTCOME | second])
    return tmp_path


def test_means_savings_and_infeasible_cycles(folder: Path) -> None:
    cycles = read_published(folder)["model"]
    assert [cycle.infeasible for cycle in cycles] == [False, True]
    one = summary("model", cycles)
    assert (one.cycles, one.fewer, one.infeasible) == (2, 1, 1)
    assert one.bytes_per_frame == 100_000
    assert one.saved == pytest.approx(0.5)
    assert one.paired_saved == pytest.approx((2 / 3 + 0) / 2)
    assert one.lost_ap_70.mean == pytest.approx(-0.025)
    assert one.lost_ap_70.low == pytest.approx(-0.025), "one scenario has no spread"
    assert one.response_s == 40


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("eval.csv", {"avg_ap_07": "much"}, "eval.csv: avg_ap_07 of scenario street is 'much'"),
        ("eval.csv", {"scenario": "other"}, "eval.csv has no row for scenario street"),
    ],
)
def test_what_does_not_fit_is_named(
    folder: Path, name: str, change: dict[str, str], words: str
) -> None:
    write(folder / "model" / "test" / name, EVAL_COLUMNS, [OUTCOME | change])
    assert_refused(folder, words)


def test_a_file_cut_off_is_named_with_its_line(folder: Path) -> None:
    path = folder / "model" / "test" / "eval_baseline.csv"
    path.write_text(path.read_text()[:-30])
    assert_refused(folder, "eval_baseline.csv, line 3: no ")


def test_a_folder_with_something_else_is_refused(tmp_path: Path) -> None:
    assert_refused(tmp_path, "holds no published results")
    assert_refused(tmp_path / "nowhere", "is not a folder")


def assert_refused(folder: Path, words: str) -> None:
    with pytest.raises(EvaluationError) as error:
        read_published(folder)
    assert words in str(error.value)


@pytest.mark.data
def test_the_published_files_give_their_published_means(capsys: pytest.CaptureFixture[str]) -> None:
    folder = data_folder(Path("paper-results"))
    if folder is None:
        pytest.skip("no published results: set COADAPT_DATA to a folder with paper-results/")
    assert main(["eval", "published", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = {row["name"]: row for row in document["rows"]}
    assert {row["cycles"] for row in rows.values()} == {51}
    assert rows["rulebased"]["ap_70"] == pytest.approx(0.811, abs=5e-4)
    assert rows["llama3.3"]["everyone_ap_70"] == pytest.approx(0.889, abs=5e-4)
    assert rows["gemma4"]["bytes_per_frame"] == pytest.approx(152e3, abs=500)
    assert any(
        one["decided_by"] == "gemma4" and one["needs_bps"] > 100e6 for one in document["infeasible"]
    )
    assert main(["eval", "published", str(folder)]) == 0
    assert "llama3.3: left somebody out in 38 of 51 cycles" in capsys.readouterr().out
