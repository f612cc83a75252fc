"""Places that an ego asks about, on the wire."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.codec.places import MOST_PLACES, encode_places, within
from perception.types import Boxes
from swarm.errors import PayloadError

SIZE = (2.5, 1.2, 2.1)


def boxes(*where: tuple[float, float, float]) -> Boxes:
    """Forklifts at x, y with a heading."""
    return Boxes(
        centers=np.array([(x, y, 1.0) for x, y, _ in where]).reshape(-1, 3),
        sizes=np.tile(SIZE, (len(where), 1)),
        headings=np.array([heading for _, _, heading in where], dtype=np.float64),
        scores=np.full(len(where), 0.9),
        labels=("forklift",) * len(where),
    )


def inside(box: tuple[float, float, float], points: np.ndarray, around_m: float) -> np.ndarray:
    x, y, heading = box
    along = (points[:, 0] - x) * math.cos(heading) + (points[:, 1] - y) * math.sin(heading)
    across = (points[:, 1] - y) * math.cos(heading) - (points[:, 0] - x) * math.sin(heading)
    return (np.abs(along) <= SIZE[0] / 2 + around_m) & (np.abs(across) <= SIZE[1] / 2 + around_m)


@pytest.mark.parametrize("around_m", [0.0, 1.0])
def test_points_in_a_place_are_told_from_those_beside_it(around_m: float) -> None:
    where = [(10.0, -3.0, 0.4), (-20.0, 8.0, 2.9), (11.0, -2.0, -1.2)]
    points = np.random.default_rng(1).uniform(-25, 25, (20_000, 3)).astype(np.float32)
    found = within(encode_places(boxes(*where), around_m), points)
    # Steps of the code move an edge by less than this.
    surely = np.any([inside(one, points, around_m - 0.1) for one in where], axis=0)
    perhaps = np.any([inside(one, points, around_m + 0.15) for one in where], axis=0)
    assert surely.sum() > 50 * around_m
    assert not (surely & ~found).any()
    assert not (found & ~perhaps).any()


def test_a_place_costs_seven_bytes_and_only_so_many_are_asked_about() -> None:
    assert [len(encode_places(boxes(*[(1.0, 2.0, 0.0)] * n), 0.5)) for n in (0, 1, 3)] == [0, 7, 21]
    many = encode_places(boxes(*[(1.0, 2.0, 0.0)] * (MOST_PLACES + 5)), 0.5)
    assert len(many) == 7 * MOST_PLACES
    assert within(many, np.array([[1.0, 2.0, 0.0]], dtype=np.float32)).all()


def test_what_is_too_far_for_the_code_is_left_out_and_what_is_too_long_is_cut() -> None:
    assert encode_places(boxes((700.0, 0.0, 0.0)), 1.0) == b""
    long = encode_places(boxes((0.0, 0.0, 0.0)), 100.0)
    points = np.array([[12.7, 0.0, 0.0], [12.8, 0.0, 0.0]], dtype=np.float32)
    assert within(long, points).tolist() == [True, False]


@pytest.mark.parametrize("places", [b"123456", bytes(8), bytes(7 * MOST_PLACES + 7)])
def test_what_is_no_list_of_places_is_refused(places: bytes) -> None:
    with pytest.raises(PayloadError, match=r"\d+ bytes are no places; allowed: up to 128 of 7"):
        within(places, np.zeros((1, 3), dtype=np.float32))
