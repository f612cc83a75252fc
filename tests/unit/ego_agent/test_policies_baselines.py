from __future__ import annotations

import csv
from pathlib import Path

import pytest

from ego_agent.plan.policies.registry import make_policy
from tests.support.ego_scenes import candidate, knowledge, scene
from worlds.sample import data_folder

EVERYONE = ("early", "intermediate", "late")


@pytest.mark.parametrize("algorithm", EVERYONE)
def test_static_takes_everyone_in_range_whatever_the_link(algorithm: str) -> None:
    found = scene(candidate("E"), *(candidate(r) for r in "ABCDE"[:4]), capacity_bps=10)
    proposal = make_policy(f"static-{algorithm}", EVERYONE).propose(found, knowledge(), None)
    assert proposal.participants == ("E", "A", "B", "C", "D")
    assert proposal.algorithm == algorithm


@pytest.mark.parametrize(
    ("capacity_bps", "algorithm"),
    [(5e6, "late"), (12.49e6, "late"), (12.5e6, "intermediate"), (50e6, "intermediate")],
)
def test_rules_choose_the_algorithm_by_the_link_and_the_three_nearest(
    capacity_bps: float, algorithm: str
) -> None:
    found = scene(candidate("E"), *(candidate(r) for r in "CADB"), capacity_bps=capacity_bps)
    proposal = make_policy("rules", EVERYONE).propose(found, knowledge(), None)
    assert proposal.participants == ("E", "C", "A", "D")
    assert proposal.algorithm == algorithm


@pytest.mark.data
def test_rules_agree_with_every_published_choice_up_to_the_third_nearest() -> None:
    root = data_folder(Path("paper-results"))
    files = sorted(root.glob("rulebased/*/selection.csv")) if root else []
    if not files:
        pytest.skip("no published results: set COADAPT_DATA to a folder with paper-results/")
    rows = [row for file in files for row in csv.DictReader(file.read_text().splitlines())]
    for row in rows:
        ego, *chosen = row["selected_cavs"].split("|")
        left_out = set(row["in_range_cavs"].split("|")) - {ego, *chosen}
        found = scene(
            candidate(ego),
            *(candidate(r) for r in [*chosen, *sorted(left_out)]),
            capacity_bps=float(row["bandwidth_mbps"]) * 1e6,
        )
        proposal = make_policy("rules", EVERYONE).propose(found, knowledge(), None)
        assert proposal.algorithm == row["fusion_method"]
        assert proposal.participants == (ego, *chosen[:3])
    assert len(rows) == 51
