from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.codec.boxes import BYTES_PER_BOX, decode_boxes, encode_boxes
from perception.codec.envelope import seal
from perception.types import Boxes
from swarm.errors import PayloadError, PerceptionError


def some_boxes(count: int, seed: int = 0) -> Boxes:
    rng = np.random.default_rng(seed)
    return Boxes(
        centers=rng.uniform(-2000, 2000, (count, 3)),
        sizes=rng.uniform(0, 20, (count, 3)),
        headings=rng.uniform(0, math.tau, count),
        scores=rng.uniform(0, 1, count),
        labels=tuple(str(rng.choice(["car", "forklift", "größe"])) for _ in range(count)),
    )


@given(st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_boxes_come_back_within_the_stated_bounds(count: int, seed: int) -> None:
    boxes = some_boxes(count, seed)
    back = decode_boxes(encode_boxes(boxes))
    assert back.labels == boxes.labels
    np.testing.assert_allclose(back.centers, boxes.centers, rtol=0, atol=0.0025 + 1e-9)
    np.testing.assert_allclose(back.sizes, boxes.sizes, rtol=0, atol=0.0025 + 1e-9)
    np.testing.assert_allclose(back.scores, boxes.scores, rtol=0, atol=7.7e-6)
    turn = (back.headings - boxes.headings + math.pi) % math.tau - math.pi
    assert np.abs(turn).max(initial=0) <= 4.8e-5
    assert ((back.headings >= 0) & (back.headings < math.tau)).all()


def test_a_box_costs_at_most_twenty_bytes() -> None:
    assert BYTES_PER_BOX == 20
    assert len(encode_boxes(some_boxes(101))) - len(encode_boxes(some_boxes(1))) <= 2000 + 16


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("centers", np.array([[math.nan, 0, 0]]), "centre"),
        ("sizes", np.array([[-1.0, 1, 1]]), "size"),
        ("scores", np.array([1.5]), "score"),
        ("headings", np.array([math.inf]), "heading"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_boxes_that_cannot_be_encoded_are_refused_by_name(
    field: str, value: np.ndarray, named: str
) -> None:
    fields = {name: getattr(some_boxes(1), name) for name in Boxes.__slots__}
    with pytest.raises(PerceptionError, match=named):
        encode_boxes(Boxes(**{**fields, field: value}))


@given(st.binary(max_size=200))
def test_random_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(PayloadError):
        decode_boxes(data)


@given(st.binary(max_size=200))
def test_a_random_body_with_a_right_checksum_gives_boxes_or_is_refused(body: bytes) -> None:
    with contextlib.suppress(PayloadError):
        decode_boxes(seal(16, body))


@given(st.data())
def test_a_flipped_bit_is_noticed(data: st.DataObject) -> None:
    payload = bytearray(encode_boxes(some_boxes(5)))
    at = data.draw(st.integers(0, 8 * len(payload) - 1))
    payload[at // 8] ^= 1 << at % 8
    with pytest.raises(PayloadError):
        decode_boxes(bytes(payload))
