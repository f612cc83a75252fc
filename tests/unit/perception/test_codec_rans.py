from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.codec import tables
from perception.codec.rans import TOTAL, Decoder, Run, encode
from swarm.errors import PayloadError


def some_runs(seed: int, lengths: list[int]) -> list[Run]:
    rng = np.random.default_rng(seed)
    contexts = [rng.integers(0, tables.FIRST + 1, n).astype(np.int32) for n in lengths]
    return [(c, np.minimum(rng.geometric(0.4, len(c)) - 1, 40).astype(np.uint8)) for c in contexts]


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(0, 300), max_size=6), st.integers(1, 64))
def test_runs_come_back_run_by_run(seed: int, lengths: list[int], lanes: int) -> None:
    runs = some_runs(seed, lengths)
    model = tables.from_weights(
        tables.count(
            np.concatenate([np.zeros(0, np.int32), *(c for c, _ in runs)]),
            np.concatenate([np.zeros(0, np.uint8), *(s for _, s in runs)]),
        )
    )
    decoder = Decoder(encode(runs, model, lanes), model, lanes)
    for contexts, symbols in runs:
        np.testing.assert_array_equal(decoder.take(contexts), symbols)
    decoder.finish()


def test_a_stream_costs_its_entropy_and_three_bytes_a_lane() -> None:
    [(contexts, symbols)] = some_runs(1, [20_000])
    model = tables.from_weights(tables.count(contexts, symbols))
    ideal = -np.log2(model.frequency[contexts, symbols] / TOTAL).sum() / 8
    assert len(encode([(contexts, symbols)], model, 32)) <= 1.002 * ideal + 4 * 32


@given(st.binary(max_size=3000))
def test_any_weights_give_valid_tables(weights: bytes) -> None:
    frequency = tables.from_weights(weights).frequency
    assert (frequency.sum(axis=1) == TOTAL).all()
    assert frequency.max() < TOTAL


def test_a_stream_with_something_left_over_is_refused() -> None:
    [(contexts, symbols)] = some_runs(2, [500])
    model = tables.from_weights(tables.count(contexts, symbols))
    decoder = Decoder(encode([(contexts, symbols)], model, 4), model, 4)
    decoder.take(contexts[:-1])
    with pytest.raises(PayloadError, match="end"):
        decoder.finish()
