"""Bytes as CoAdapt's published results count them, beside those that are sent here."""

from __future__ import annotations

from pathlib import Path

import pytest

from research.evaluation.policies.as_published import by_algorithm, by_policy, tables
from research.evaluation.policies.decide import Decided
from research.evaluation.policies.results import Row
from research.evaluation.windows import links
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.contents import Contents, Uncoded, bytes_as_published, contents
from research.evaluation.windows.measure import Window
from research.evaluation.windows.scenarios import Scenario, recorded_suite
from research.training.plans import TEST_SEEDS

HELD = {"R2": Uncoded(30_000.0, 4.0), "R3": Uncoded(10_000.0, 5.5)}


@pytest.mark.parametrize(
    ("participants", "algorithm", "size"),
    [
        (("R2", "R3"), "early", 40_000 * 16),
        (("R2", "R3"), "late", 9.5 * 28),
        (("R3",), "intermediate", 32 * 128 * 128 * 4),
        (("R2", "R3"), "intermediate-codebook", 2 * 32 * 128 * 128 * 4),
        ((), ALONE, 0),
    ],
)
def test_floats_are_counted_whole(
    participants: tuple[str, ...], algorithm: str, size: float
) -> None:
    assert bytes_as_published(Choice(participants, algorithm), HELD, "factory") == size


def test_a_robot_holds_its_points_and_the_objects_around_it() -> None:
    scenario = Scenario("small", 3, links.shift(), TEST_SEEDS.start + 555_558, sampled=2)
    window = Window(scenario, 0)
    held = contents(window)
    assert set(held) == {"R2", "R3"}
    frames = scenario.sampled_frames(0)
    points = [len(window.world.scan("R2", frame).points) for frame in frames]
    assert held["R2"].points == sum(points) / 2
    truth = window.world.ground_truth(frames[0])
    assert 3 < held["R2"].objects <= len(truth.ids) - 1


@pytest.mark.data
def test_on_a_recording_they_are_about_what_its_files_list(opv2v_dir: Path) -> None:
    held = contents(Window(recorded_suite(opv2v_dir)[0], 0))
    (other,) = held.values()
    assert 57_000 < other.points < 58_000
    assert other.objects == pytest.approx(22, abs=2), "its annotations list 20 to 23 vehicles"


def row(policy: str, choice: Choice, size: float, window: int = 0) -> Row:
    decided = Decided(
        "small", window, ("R1", "R2", "R3"), "R1", ("R2", "R3"), policy, choice, 10, "", "policy",
        0.01,
    )  # fmt: skip
    outcome = Outcome(0.8, 0.8, 0.8, size, 4, 9, None)
    return Row(Scenario("small", 3, links.shift()), decided, outcome, 5e6, False, 0.8, 0.8, 0, None)


def test_both_accountings_stand_side_by_side() -> None:
    both, one = Choice(("R2", "R3"), "early"), Choice(("R2",), "late")
    rows = [
        row("static-early", both, 9_000.0),
        row("coverage", one, 500.0),
        row("coverage~first", Choice(("R3",), "late"), 500.0),
        row("coverage", Choice((), ALONE), 0.0, window=1),
        row("oracle", both, 9_000.0),
    ]
    held = Contents("factory", {("small", 0): HELD, ("small", 1): HELD})
    policies = {found.of: found for found in by_policy(rows, held)}
    assert list(policies) == ["static-early", "coverage", "oracle"]
    assert policies["static-early"].published_bytes_per_frame == 640_000
    assert policies["static-early"].published_infeasible_ratio == 1, "51 Mbit/s on a link of 5"
    assert policies["coverage"].bytes_per_frame == 250
    assert policies["coverage"].published_bytes_per_frame == 4 * 28 / 2
    assert policies["coverage"].published_infeasible_ratio == 0
    early, late = by_algorithm(rows, held)
    assert (early.of, early.bytes_per_frame, early.published_bytes_per_frame) == (
        "early", 4_500, 320_000,
    )  # fmt: skip
    assert late.published_bytes_per_frame == (4 * 28 + 5.5 * 28) / 2
    assert "640.00" in tables(rows, held)[0]
