"""Drawing tokens by their probability."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from llm_gateway.backends.llamacpp.sampler import Sampler, probability

LOGITS = np.log(np.array([0.1, 0.6, 0.3], np.float32))


def shares(sampler: Sampler, draws: int = 4000) -> list[float]:
    drawn = [sampler.draw(LOGITS) for _ in range(draws)]
    return [drawn.count(token) / draws for token in range(len(LOGITS))]


def test_tokens_come_as_often_as_they_are_likely() -> None:
    assert np.allclose(shares(Sampler(1.0, seed=1)), [0.1, 0.6, 0.3], atol=0.03)


def test_a_low_temperature_prefers_the_likeliest_and_a_high_one_levels() -> None:
    cold, warm = shares(Sampler(0.2, seed=1)), shares(Sampler(2.0, seed=1))
    assert cold[1] > 0.95
    assert 0.35 < warm[1] < 0.5


def test_top_p_leaves_out_the_unlikely() -> None:
    assert shares(Sampler(1.0, 0.5, seed=1)) == [0, 1, 0]
    assert np.allclose(shares(Sampler(1.0, 0.7, seed=1)), [0, 2 / 3, 1 / 3], atol=0.03)
    assert Sampler(1.0, 0.0, seed=1).draw(LOGITS) == 1


def test_what_is_forbidden_is_never_drawn() -> None:
    logits = np.array([-np.inf, 0.0, -np.inf], np.float32)
    assert {Sampler(2.0, seed=seed).draw(logits) for seed in range(20)} == {1}


@pytest.mark.parametrize("temperature", [1e-3, 1e-100, 1e-307, sys.float_info.min, 5e-324])
def test_however_cold_it_is_the_likeliest_is_drawn(temperature: float) -> None:
    sampler = Sampler(temperature, seed=1)
    assert {sampler.draw(LOGITS) for _ in range(20)} == {1}
    forbidden = np.array([-np.inf, -3.0, -np.inf], np.float32)
    assert sampler.draw(forbidden) == 1


def test_a_tokens_probability_is_among_all_that_may_come() -> None:
    assert [round(probability(LOGITS, token), 5) for token in range(3)] == [0.1, 0.6, 0.3]
    barred = np.array([-np.inf, 3.0, -2000.0], np.float32)
    assert probability(barred, 1) == 1.0
    assert probability(barred, 2) == pytest.approx(0.0, abs=1e-300)
