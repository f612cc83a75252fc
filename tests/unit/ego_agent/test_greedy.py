"""Greedy growth works out few gains anew; what it finds is what working out all would find."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ego_agent.knowledge.answers import AnswerTimes, Pool, Weighted
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.greedy import AT_A_TIME, SMALLEST_GAIN, grow
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.union import Union
from tests.support.ego_scenes import candidate, knowledge, scene

ROBOTS = 4 * AT_A_TIME
CELLS = 900


def crowd(seed: int, *, late: bool) -> UnifiedScene:
    """Robots that see overlapping strips of a floor and some of its objects; some are `late`."""
    rng = np.random.default_rng(seed)
    robots = []
    for number in range(ROBOTS):
        first, length = rng.integers(CELLS), rng.integers(10, 120)
        share = float(rng.uniform(0.1, 0.9)) if late and number % 2 else 1.0
        times = Pool.of([Weighted(0.1, 20 * share, 0.0), Weighted(0.6, 0.0, 20 * (1 - share))])
        one = candidate(
            f"R{number:02}",
            (np.arange(first, first + length) % CELLS).tolist(),
            rng.uniform(size=12).round(2).tolist(),
            sizes={"early": int(rng.integers(500, 9_000))},
            of=(30, 30),
        )
        robots.append(replace(one, answers={"early": AnswerTimes(own=times, frames=20.0)}))
    ego = candidate("E", range(40), [0.5] * 12, of=(30, 30))
    return scene(ego, *robots, capacity_bps=6e6)


def plain(scorer: Scorer, *, by_byte: bool) -> Iterator[tuple[str, ...]]:
    """The sets on the way of the greedy order, all gains worked out at each step."""
    arrival, union, chosen = scorer.counting("early"), Union(scorer.views), list[int]()
    left = {row: scorer.scene.candidates[row - 1].sizes["early"] for row in range(1, ROBOTS + 1)}
    spent = 0
    while True:
        rows = np.array([row for row in left if spent + left[row] <= scorer.budget_bytes])
        gains = union.gains(rows, arrival[rows]) if len(rows) else np.zeros(0)
        rows, gains = rows[gains > SMALLEST_GAIN], gains[gains > SMALLEST_GAIN]
        if not len(rows):
            return
        sizes = np.array([left[row] for row in rows])
        row = int(rows[np.argmax(gains / sizes if by_byte else gains)])
        chosen.append(row)
        spent += left.pop(row)
        union.add(row, float(arrival[row]))
        yield tuple(scorer.scene.candidates[row - 1].robot for row in sorted(chosen))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("by_byte", [True, False])
def test_the_sets_are_those_of_working_out_every_gain(seed: int, late: bool, by_byte: bool) -> None:
    found = crowd(seed, late=late)
    scorer = Scorer(found, knowledge())
    grown = list(grow(scorer, found.candidates, "early", by_byte=by_byte))
    expected = list(plain(scorer, by_byte=by_byte))
    assert [score.participants for score in grown] == expected
    assert len(grown) > 5
    # Gains of evidence are counted in steps.
    chosen = [scorer.row_of[robot] for robot in grown[-1].participants]
    share = scorer.share([0, *chosen], "early")
    assert grown[-1].quality == pytest.approx(scorer.quality("early", share, 1), abs=0.005)


def test_only_those_asked_for_are_tried() -> None:
    found = crowd(0, late=False)
    some = found.candidates[::7]
    grown = list(grow(Scorer(found, knowledge()), some, "early", by_byte=True))
    assert {*grown[-1].participants} <= {one.robot for one in some}
