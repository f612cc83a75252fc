"""The law that is fitted to assignments: it finds the one that made them."""

from __future__ import annotations

import numpy as np
import pytest

from ego_agent.knowledge.quality import quality_of
from research.evaluation.ways.fit_rates import Law, fitted, model_of, shares
from research.evaluation.ways.sampling import (
    BETWEEN_HZ,
    FORMS,
    RATES_HZ,
    Look,
    Sample,
    Sampled,
    drives,
    random_assignments,
)
from swarm.errors import EvaluationError
from swarm.messages import Assignment

GAINS = {"late": 0.3, "intermediate": 0.4, "early": 0.5}
ARRIVES = {
    form: dict(zip(RATES_HZ, row, strict=True))
    for form, row in (
        ("early", (0.9, 0.8, 0.6, 0.4, 0.2)),
        ("intermediate", (0.9, 0.8, 0.6, 0.4, 0.2)),
        ("late", (0.9, 0.85, 0.7, 0.5, 0.3)),
    )
}
ARRIVES["early+places"] = {5.0: 0.88, 2.0: 0.85, 1.0: 0.75, 0.5: 0.55}


def drive(number: int) -> Sampled:
    rng = np.random.default_rng(number)
    robots = [f"R{i}" for i in range(2, 7)]
    own = float(rng.uniform(0.3, 0.7))
    seen = (rng.random((len(robots), 60)) < 0.35).astype(np.float32)
    weights = np.full(60, (1.0 - own) / 60, dtype=np.float32)
    looks = (Look(own, tuple(robots), seen, weights),)
    rises = np.diff([0.0, *GAINS.values()])
    samples = []
    for assignments in random_assignments(robots, number, BETWEEN_HZ["factory"]):
        empty = Sample(assignments, 0.0)
        added = float(shares(looks, empty, ARRIVES) @ rises)
        samples.append(Sample(assignments, 0.2 + 0.4 * own + added))
    return Sampled(looks, tuple(samples))


def test_the_law_that_made_the_samples_is_found() -> None:
    law = fitted([drive(number) for number in range(16)], BETWEEN_HZ["factory"])
    assert law.level == pytest.approx(0.2 + 0.4 * law.own_share, abs=0.02)
    for form in FORMS:
        assert law.gains[form] == pytest.approx(GAINS[form], abs=0.04)
    for kind, table in ARRIVES.items():
        for hz, part in table.items():
            assert law.arrives[kind][hz] == pytest.approx(part, abs=0.08), (kind, hz)
    assert law.error < 0.1 * law.spread


def test_a_lower_rate_is_never_worth_more() -> None:
    law = fitted([drive(number) for number in range(4)], BETWEEN_HZ["factory"])
    for table in law.arrives.values():
        assert [*table.values()] == sorted(table.values(), reverse=True)


def test_one_drive_is_too_few() -> None:
    with pytest.raises(EvaluationError, match="1 drives are too few"):
        fitted([drive(1)], BETWEEN_HZ["factory"])


def test_of_nobody_nothing_is_shown() -> None:
    one = drive(3)
    stranger = Sample((Assignment(robot="R99", algorithm="early", rate_hz=10.0),), 0.0)
    assert shares(one.looks, stranger, ARRIVES).tolist() == [0.0, 0.0, 0.0]


def test_forms_that_were_not_measured_gain_like_their_kind() -> None:
    law = Law(0.6, 0.5, GAINS, ARRIVES, 0.0, 0.0)
    model, usual = model_of(law, "factory"), quality_of("factory")
    assert model.base + 0.5 * model.own == pytest.approx(0.6, abs=1e-3)
    assert model.calibrated
    assert model.gain("early") == GAINS["early"]
    ratio = usual.gain("intermediate-sparse") / usual.gain("intermediate")
    assert model.gain("intermediate-sparse") == pytest.approx(0.4 * ratio, abs=1e-3)


def test_egos_take_turns_on_floors_of_their_own() -> None:
    found = drives("factory", 12, 60)
    assert len({one.seed for one in found}) == 12
    assert {one.ego for one in found} > {0, 1, 2}
    assert all(one.ego < one.robots for one in found)
