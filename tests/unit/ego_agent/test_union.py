"""Expected coverage: what a set shows when each of its robots may or may not arrive."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ego_agent.plan.choices.union import LEVELS, Union, Views

CELLS, OBJECTS = 5, 3
rows = st.integers(2, 5)
chances = st.sampled_from([0.0, 0.25, 0.5, 0.95, 1.0])
steps = st.integers(0, LEVELS)


@st.composite
def floors(draw: st.DrawFn) -> tuple[Views, NDArray[np.bool_], NDArray[np.float64], list[float]]:
    """Robots with areas, evidence in whole steps, and probabilities to arrive; the ego's is 1."""
    count = draw(rows)
    area = np.array([[draw(st.booleans()) for _ in range(CELLS**2)] for _ in range(count)])
    evidence = np.array([[draw(steps) for _ in range(OBJECTS)] for _ in range(count)]) / LEVELS
    arrival = [1.0, *(draw(chances) for _ in range(count - 1))]
    return Views(area.reshape(count, CELLS, CELLS), evidence, 0.01, 0.1), area, evidence, arrival


def by_hand(area: NDArray[np.bool_], evidence: NDArray[np.float64], arrival: list[float]) -> float:
    """The mean over all ways to arrive."""
    total = 0.0
    for came in itertools.product((False, True), repeat=len(arrival)):
        chance = np.prod([p if c else 1.0 - p for c, p in zip(came, arrival, strict=True)])
        if chance > 0.0:
            there = np.array(came)
            seen = 0.01 * area[there].any(axis=0).sum() + 0.1 * evidence[there].max(axis=0).sum()
            total += float(chance) * seen
    return total


def union_of(views: Views, arrival: list[float], order: list[int]) -> Union:
    union = Union(views)
    for row in order:
        union.add(row, arrival[row])
    return union


@settings(max_examples=200, deadline=None)
@given(floors(), st.randoms(use_true_random=False))
def test_the_expected_share_is_the_mean_over_all_ways_to_arrive_in_any_order(
    floor: tuple[Views, NDArray[np.bool_], NDArray[np.float64], list[float]], shuffle: object
) -> None:
    views, area, evidence, arrival = floor
    order = list(range(1, len(arrival)))
    shuffle.shuffle(order)  # type: ignore[attr-defined]
    found = union_of(views, arrival, order).share()
    assert found == pytest.approx(by_hand(area, evidence, arrival), abs=1e-5)


@settings(max_examples=200, deadline=None)
@given(floors())
def test_a_gain_is_what_the_share_grows_by_and_never_grows_with_the_set(
    floor: tuple[Views, NDArray[np.bool_], NDArray[np.float64], list[float]],
) -> None:
    views, _, _, arrival = floor
    last = len(arrival) - 1
    at, chance = np.array([last]), np.array([arrival[last]])
    before: float | None = None
    for size in range(last):
        union = union_of(views, arrival, list(range(1, size + 1)))
        gain = float(union.gains(at, chance)[0])
        share = union.share()
        union.add(last, arrival[last])
        assert union.share() - share == pytest.approx(gain, abs=1e-5)
        assert gain >= -1e-9
        assert before is None or gain <= before + 1e-6
        before = gain


def test_where_all_arrive_the_share_is_coverage_to_the_bit() -> None:
    rng = np.random.default_rng(1)
    area, evidence = rng.random((6, 20, 20)) < 0.3, rng.random((6, 40))
    views = Views(area, evidence, 0.5 / 400, 0.5 / 40)
    union = union_of(views, [1.0] * 6, [3, 1, 5])
    there = [0, 1, 3, 5]
    cells, best = area[there].any(axis=0).sum(), evidence[there].max(axis=0).sum()
    assert union.share() == 0.5 / 400 * float(cells) + 0.5 / 40 * float(best)
