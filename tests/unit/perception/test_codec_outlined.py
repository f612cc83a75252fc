"""Payloads with outlines on the wire."""

from __future__ import annotations

import numpy as np
import pytest

from perception.codec.envelope import seal
from perception.codec.outlined import KIND_OUTLINED, STEP_M, add_outline, take_outline
from swarm.errors import PayloadError


@pytest.mark.parametrize("count", [0, 1, 48, 255])
def test_a_payload_arrives_whole_and_its_outline_within_half_a_step(count: int) -> None:
    places = np.random.default_rng(1).uniform(-51, 51, (count, 2))
    payload, seen = take_outline(add_outline(b"points", places))
    assert payload == b"points"
    assert seen.shape == (count, 2)
    assert np.abs(seen - places).max(initial=0.0) <= STEP_M / 2 + 1e-9


def test_places_that_do_not_fit_are_left_out() -> None:
    far = np.array([[1.0, 2.0], [60.0, 0.0], [0.0, np.nan], [-51.0, 51.0]])
    assert np.allclose(take_outline(add_outline(b"", far))[1], [[1, 2], [-51, 51]])
    assert len(take_outline(add_outline(b"", np.zeros((400, 2))))[1]) == 255


def test_a_place_costs_three_bytes() -> None:
    sizes = [len(add_outline(b"", np.zeros((n, 2)))) for n in (0, 1)]
    assert sizes[1] - sizes[0] == 3


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (seal(16, b"boxes"), "kind 16 has no outline"),
        (seal(KIND_OUTLINED, b""), "does not hold its outline"),
        (seal(KIND_OUTLINED, bytes((3,)) + bytes(8)), "does not hold its outline"),
        (add_outline(b"", np.zeros((2, 2)))[:-1], "checksum"),
    ],
)
def test_what_is_no_such_payload_is_refused(payload: bytes, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        take_outline(payload)
