from __future__ import annotations

import math

import numpy as np
import pytest

from perception.scene import COLUMNS, from_array, to_array
from perception.types import Scene, SceneObject
from swarm.errors import ScanError
from swarm.geometry import Pose

CAR = SceneObject((10.0, 2.0, -1.0), math.sqrt(105.0), (4.0, 2.0, 1.5), 200, 16.75)
POLE = SceneObject((-3.0, 4.0, 0.5), math.sqrt(25.25), (0.25, 0.25, 3.0), 12, 40.0)
SCENE = Scene((CAR, POLE), 5000)


def test_a_scene_comes_back_from_its_array() -> None:
    array = to_array(SCENE, np.eye(4))
    assert array.dtype == np.float32
    assert array.shape == (2, len(COLUMNS))
    back = from_array(array, ground_points=5000)
    assert back.ground_points == 5000
    assert [o.points for o in back.objects] == [200, 12]
    np.testing.assert_allclose(to_array(back, np.eye(4)), array)
    assert back.objects[0].centroid == CAR.centroid


def test_centroids_are_placed_in_the_world_and_the_distance_stays() -> None:
    array = to_array(SCENE, Pose(100.0, 50.0, 2.0, yaw=math.pi / 2).matrix())
    np.testing.assert_allclose(array[0, :3], [98.0, 60.0, 1.0], atol=1e-5)
    assert array[0, 3] == pytest.approx(CAR.distance)
    np.testing.assert_allclose(array[0, 4:7], [2.0, 4.0, 1.5], atol=1e-5)


def test_a_turned_size_covers_the_object() -> None:
    array = to_array(SCENE, Pose(0, 0, 0, yaw=math.pi / 4).matrix())
    np.testing.assert_allclose(array[0, 4:7], [6 / math.sqrt(2), 6 / math.sqrt(2), 1.5], atol=1e-5)


def test_an_empty_scene_is_an_empty_array() -> None:
    array = to_array(Scene((), 7), np.eye(4))
    assert array.shape == (0, 9)
    assert from_array(array, 7) == Scene((), 7)


def test_an_array_of_another_width_is_refused() -> None:
    with pytest.raises(ScanError, match=r"\(N, 9\)"):
        from_array(np.zeros((2, 8), np.float32))
