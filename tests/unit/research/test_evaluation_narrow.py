"""Ways that are decided, on links that do not carry everything; and what rates bring."""

from __future__ import annotations

import numpy as np
import pytest

from ego_agent.knowledge.objective import Objective
from perception.detector.weight_files import has_weights
from perception.types import Boxes
from research.evaluation.ways import narrow
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.measure import Measured
from research.evaluation.ways.planned import (
    ALGORITHMS,
    GUESSED,
    RANDOM,
    Decided,
    Deciding,
)
from research.evaluation.ways.rate_table import BySpeed
from worlds.factory.world import FactoryWorld

needs_weights = pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")


def boxes(*places: float) -> Boxes:
    n = len(places)
    centers = np.column_stack([places, np.zeros(n), np.zeros(n)]) if n else np.zeros((0, 3))
    return Boxes(centers, np.ones((n, 3)), np.zeros(n), np.ones(n), ("person",) * n)


@pytest.fixture(scope="module")
def driven() -> Driven:
    return Driven(Drive("factory", 1_960_000, 3, 0, 60, 10))


@needs_weights
@pytest.mark.parametrize("policy", ["coverage", RANDOM, GUESSED])
def test_what_is_decided_fits_the_link(driven: Driven, policy: str) -> None:
    link_bps = 1e5
    deciding = Deciding(driven, Decided(policy, rarer=True, price=0.0), lambda _: link_bps)
    sent, robots = 0, set()
    for number, frame in enumerate(driven.frames):
        asked = deciding.asked(number, frame)
        assert {*asked.values()} <= {*ALGORITHMS}
        robots |= {*asked}
        sent += sum(driven.size(frame, robot, form, 0.1) for robot, form in asked.items())
    assert robots
    # Sizes are those of seconds ago, and frames begin anywhere in a period.
    assert 8 * sent / 1.0 <= 2.0 * Objective().headroom * link_bps


def test_ours_stands_beside_each_control_in_pairs() -> None:
    link = narrow.LINKS[0]
    names = [way.name for way in narrow.ways(link)]

    def measured(found: bool, bytes_: int) -> Measured:
        one = Measured(bytes=bytes_)
        one.tally.add(boxes(0.0, 9.0) if found else boxes(0.0), boxes(0.0, 9.0), [bytes_])
        return one

    part = [measured(name == narrow.OURS, 100 if name == narrow.OURS else 200) for name in names]
    found = narrow.table(link, [part, part])
    beside = found["beside"][narrow.OURS]["best_single_policy"]
    assert beside["control"] in narrow.SINGLE_POLICIES
    assert beside["difference"] == pytest.approx(0.5, abs=0.1)
    assert beside["bytes_ratio"] == 0.5
    assert found["drives"] == 2


def test_objects_are_told_apart_by_their_speed() -> None:
    world, counted = FactoryWorld(robots=2, seed=1_000_003), BySpeed()
    truth = world.ground_truth(40)
    counted.add(world, 40, truth.boxes, truth.boxes, truth.ids)
    counted.add(world, 40, Boxes.empty(), truth.boxes, truth.ids)
    assert set(counted.shares().values()) == {0.5}
    assert len(counted.shares()) >= 2
    assert sum(counted.there.values()) == 2 * len(truth.ids)
