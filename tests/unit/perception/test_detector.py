"""The cluster detector on built scenes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.boxes import iou_bev
from perception.detector import configuration, detect
from perception.types import Boxes
from swarm.errors import PerceptionError
from swarm.geometry import Points, Pose, transform

ROAD, FACTORY = configuration("road"), configuration("factory")
SENSOR_HEIGHT_M = 1.8
Size = tuple[float, float, float]


def ground(slope: float = 0.0) -> Points:
    """Ground that rises along x, 80 m x 60 m, in the frame of a sensor above the origin."""
    x, y = np.meshgrid(np.arange(-40, 40, 0.5), np.arange(-30, 30, 0.5))
    z = slope * x - SENSOR_HEIGHT_M
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()]).astype(np.float32)


def solid(x: float, y: float, heading: float, size: Size, seen_from: tuple[float, float]) -> Points:
    """The sides of a box on the ground at (x, y) that can be seen from a place."""
    length, width, height = size
    u, z = np.meshgrid(np.linspace(-0.5, 0.5, 40), np.arange(0.3, height, 0.08))
    u, z = u.ravel(), z.ravel() - SENSOR_HEIGHT_M
    to_world = Pose(x, y, 0, yaw=heading).matrix()
    eye = to_world[:2, :2].T @ (np.array(seen_from) - (x, y))
    faces = []
    if abs(eye[0]) > length / 2:
        faces.append(
            np.column_stack([np.full(u.size, math.copysign(length / 2, eye[0])), u * width, z])
        )
    if abs(eye[1]) > width / 2:
        faces.append(
            np.column_stack([u * length, np.full(u.size, math.copysign(width / 2, eye[1])), z])
        )
    return transform(to_world, np.concatenate(faces))


def box(x: float, y: float, heading: float, size: Size) -> Boxes:
    return Boxes(
        np.array([[x, y, size[2] / 2 - SENSOR_HEIGHT_M]]),
        np.array([size]),
        np.array([heading]),
        np.ones(1),
        ("",),
    )


CAR = (4.5, 1.95, 1.55)


@given(
    bearing=st.floats(0, 2 * math.pi),
    distance=st.floats(6, 25),
    heading=st.floats(0, 2 * math.pi),
)
def test_a_car_is_found_where_it_is_and_as_it_is_turned(
    bearing: float, distance: float, heading: float
) -> None:
    x, y = distance * math.cos(bearing), distance * math.sin(bearing)
    cloud = np.concatenate([ground(), solid(x, y, heading, CAR, (0, 0))])
    found = detect(cloud, ROAD)
    assert len(found) == 1
    assert iou_bev(found, box(x, y, heading, CAR))[0, 0] > 0.6
    assert found.centers[0, 2] == pytest.approx(CAR[2] / 2 - SENSOR_HEIGHT_M, abs=0.2)
    assert found.labels == ("vehicle",)


def test_what_is_hidden_is_added_away_from_the_sensor_that_saw_the_rest() -> None:
    back = np.array([[20.0, 0.0]])
    cloud = np.concatenate([ground(), solid(22.25, 0, 0, CAR, (0, 0))])
    seen_from_behind = detect(cloud, ROAD)
    assert seen_from_behind.centers[0, 0] == pytest.approx(22.25, abs=0.2)
    seen_from_ahead = detect(cloud, ROAD, np.array([[40.0, 0.0, 0.0]]))
    assert seen_from_ahead.centers[0, 0] == pytest.approx(back[0, 0] - 2.25, abs=0.2)


def test_a_whole_car_scores_higher_than_a_glimpse_of_one() -> None:
    whole = solid(10, 5, 0.3, CAR, (0, 0))
    glimpse = solid(10, -5, 0.3, CAR, (0, 0))[::12]
    found = detect(np.concatenate([ground(), whole, glimpse]), ROAD)
    assert found.centers[:, 1].tolist() == sorted(found.centers[:, 1], reverse=True)
    assert found.scores[0] > found.scores[1]


def test_on_a_slope_the_ground_is_no_object() -> None:
    car = solid(12, 3, 1.0, CAR, (0, 0)) + np.array([0, 0, 0.6], np.float32)
    cloud = np.concatenate([ground(0.05), car])
    assert len(detect(cloud, ROAD)) == 1


def test_walls_posts_and_kerbs_are_no_vehicles() -> None:
    things = [
        solid(10, 12, 0, (25, 0.3, 2.5), (0, 0)),
        solid(8, -6, 0, (0.3, 0.3, 3.0), (0, 0)),
        solid(-10, 3, 0, (5.0, 0.5, 0.4), (0, 0)),
    ]
    assert len(detect(np.concatenate([ground(), *things]), ROAD)) == 0


@pytest.mark.parametrize(
    ("label", "size"),
    [("person", (0.5, 0.5, 1.75)), ("robot", (0.9, 0.6, 1.26)), ("forklift", (2.5, 1.2, 2.1))],
)
def test_the_factorys_actors_are_told_apart_by_size(label: str, size: Size) -> None:
    cloud = np.concatenate([ground(), solid(6, 2, 0.4, size, (0, 0))])
    found = detect(cloud, FACTORY)
    assert found.labels == (label,)
    assert iou_bev(found, box(6, 2, 0.4, size))[0, 0] > 0.6


def test_coding_noise_does_not_make_a_known_model_larger() -> None:
    noise = np.random.default_rng(0).uniform(-0.08, 0.08, (3000, 3)).astype(np.float32)
    forklift = solid(6, 2, 0.4, (2.5, 1.2, 2.1), (0, 0))
    found = detect(np.concatenate([ground(), forklift + noise[: len(forklift)]]), FACTORY)
    assert found.sizes.tolist() == [[2.5, 1.2, 2.1]]


def test_the_robots_own_body_is_not_detected() -> None:
    assert len(detect(np.concatenate([ground(), solid(0, 0, 0, CAR, (9, 9))]), ROAD)) == 0


BROKEN = [
    np.zeros((0, 3)),
    np.full((50, 3), np.nan),
    np.full((50, 3), np.inf),
    np.full((50, 3), 3e38),
    np.zeros((50, 3)),
    np.array([[5.0, 5.0, 0.0]]),
]


@pytest.mark.parametrize("cloud", BROKEN, ids=range(len(BROKEN)))
@pytest.mark.parametrize("config", [ROAD, FACTORY], ids=["road", "factory"])
def test_a_cloud_without_objects_has_no_boxes(cloud: Points, config: object) -> None:
    assert len(detect(cloud.astype(np.float32), config)) == 0  # type: ignore[arg-type]


def test_bad_points_among_good_ones_change_nothing() -> None:
    good = np.concatenate([ground(), solid(10, 5, 0.3, CAR, (0, 0))])
    bad = np.array([[np.nan, 0, 0], [np.inf, 1, 1], [1e30, 0, 0]], dtype=np.float32)
    expected, found = detect(good, ROAD), detect(np.concatenate([bad, good, bad]), ROAD)
    assert np.array_equal(found.centers, expected.centers)


def test_an_unknown_configuration_is_named() -> None:
    with pytest.raises(PerceptionError, match="'sea' is not known; allowed: road, factory"):
        configuration("sea")
