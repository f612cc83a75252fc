"""Points with landmarks on the wire."""

from __future__ import annotations

import numpy as np
import pytest

from perception.codec.envelope import seal, unseal
from perception.codec.landmarks import KIND_LANDMARKED, add_landmarks, take_landmarks
from perception.codec.points import decode_points, encode_points
from swarm.errors import PayloadError

CLOUD = np.random.default_rng(0).uniform(-20, 20, (500, 3)).astype(np.float32)
POINTS = encode_points(CLOUD, 0.05)


@pytest.mark.parametrize("count", [0, 1, 30, 255])
def test_points_and_landmarks_arrive_within_a_centimetre(count: int) -> None:
    landmarks = np.random.default_rng(1).uniform(-300, 300, (count, 2))
    points, seen = take_landmarks(add_landmarks(POINTS, landmarks), 10_000)
    assert np.array_equal(points, decode_points(POINTS))
    assert seen.shape == (count, 2)
    assert np.abs(seen - landmarks).max(initial=0.0) <= 0.005 + 1e-9


def test_landmarks_that_do_not_fit_are_left_out() -> None:
    far = np.array([[1.0, 2.0], [400.0, 0.0], [0.0, np.nan], [3.0, 4.0]])
    assert np.allclose(take_landmarks(add_landmarks(POINTS, far), 10_000)[1], [[1, 2], [3, 4]])
    assert len(take_landmarks(add_landmarks(POINTS, np.zeros((400, 2))), 10_000)[1]) == 255


def test_a_landmark_costs_four_bytes() -> None:
    sizes = [len(add_landmarks(POINTS, np.zeros((n, 2)))) for n in (0, 1)]
    assert sizes[1] - sizes[0] == 4


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (POINTS, "is not points with landmarks"),
        (seal(KIND_LANDMARKED, b""), "does not hold its landmarks"),
        (seal(KIND_LANDMARKED, bytes((3,)) + bytes(8)), "does not hold its landmarks"),
        (seal(KIND_LANDMARKED, bytes((1,)) + bytes(4)), "at least"),
        (add_landmarks(POINTS, np.zeros((2, 2)))[:-1], "checksum"),
    ],
)
def test_what_is_no_such_payload_is_refused(payload: bytes, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        take_landmarks(payload, 10_000)


def test_more_points_than_allowed_are_refused() -> None:
    whole = add_landmarks(POINTS, np.zeros((0, 2)))
    with pytest.raises(PayloadError):
        take_landmarks(whole, 100)
    assert unseal(whole)[0] == KIND_LANDMARKED
