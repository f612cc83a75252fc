"""What docs claim of the experiments is what `make eval` wrote."""

from __future__ import annotations

import json

import pytest

from tests.support.paths import REPOSITORY

RESULTS = REPOSITORY / "docs" / "results"
Cells = tuple[str, ...]


def table_rows(text: str) -> list[Cells]:
    """The rows of a Markdown text's tables, without their rulers."""
    lines = [line for line in text.splitlines() if line.startswith("|") and "---" not in line]
    return [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines]


@pytest.fixture
def written() -> list[Cells]:
    return table_rows((RESULTS / "report.md").read_text())


def test_tables_of_results_are_rows_that_the_experiments_wrote(written: list[Cells]) -> None:
    page = (REPOSITORY / "docs" / "results.md").read_text()
    section = page.split("\n## Policies side by side\n", 1)[1].split("\n## ", 1)[0]
    rows = table_rows(section)
    assert len(rows) > 3
    assert [row for row in rows if row not in written] == []


def test_the_report_tells_of_the_headline_beside_it(written: list[Cells]) -> None:
    headline = json.loads((RESULTS / "headline.json").read_text())
    for row in headline["rows"]:
        means = [row[name] for name in ("ap_30", "ap_50", "ap_70")]
        (told,) = (line[1:4] for line in written if line[0] == row["policy"] and len(line) > 10)
        # Both are rounded, to another number of digits.
        assert [float(cell) for cell in told] == pytest.approx(means, abs=6e-4), row["policy"]
    for claim in headline["claims"]:
        met = "yes" if claim["met"] else "no"
        assert (claim["what"], str(claim["value"]), claim["target"], met) in written
