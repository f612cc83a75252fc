"""What poses err by: anew in each frame, drifting, or fixed."""

from __future__ import annotations

import numpy as np
import pytest

from sensing.opening import open_world_of
from swarm.errors import SettingError
from swarm.geometry import Pose
from swarm.process import ProcessSettings
from swarm.settings import load
from worlds.base import body_of, comm_range_of
from worlds.cooperative.pose_errors import DRIFT_FRAMES, Mislocalised, PoseErrors, disturbed
from worlds.registry import open_world

TRUE = Pose(3.0, -2.0, 1.0, yaw=0.5)


def errors(kind: PoseErrors, run: int, frames: int = 4 * DRIFT_FRAMES) -> np.ndarray:
    """x, y in metres and heading in degrees (frames, 3), of sigma 0.2."""
    poses = [disturbed(TRUE, "R2", frame, 0.2, kind, run) for frame in range(frames)]
    return np.array([(p.x - 3.0, p.y + 2.0, np.degrees(p.yaw - 0.5)) for p in poses])


def test_a_fixed_error_is_the_same_in_every_frame_and_another_in_another_run() -> None:
    assert np.ptp(errors("fixed", 1), axis=0) == pytest.approx(0.0)
    assert not np.allclose(errors("fixed", 1), errors("fixed", 2))


def test_a_drifting_error_changes_little_from_frame_to_frame_and_much_in_time() -> None:
    found = errors("drifting", 1)
    assert np.abs(np.diff(found, axis=0)).max() < 0.05
    assert np.ptp(found, axis=0).min() > 0.1


@pytest.mark.parametrize("kind", ["anew", "drifting", "fixed"])
def test_errors_are_as_large_as_asked_for(kind: PoseErrors) -> None:
    found = np.concatenate([errors(kind, run)[::DRIFT_FRAMES] for run in range(300)])
    if kind == "anew":  # The same in every run: many frames of one.
        found = errors(kind, 0, 600)
    assert found.std(axis=0) == pytest.approx(0.2, abs=0.03)


def test_robots_of_a_world_believe_to_be_beside_where_they_are() -> None:
    world = open_world("factory", robots=2, rings=16)
    astray = Mislocalised(world, 0.3, run=1)
    off = [(astray.pose("R1", frame).x - world.pose("R1", frame).x) for frame in range(0, 3000, 50)]
    assert 0.2 < float(np.std(off)) < 0.4
    scan, right = astray.scan("R2", 7), world.scan("R2", 7)
    assert scan.pose == astray.pose("R2", 7) != right.pose
    assert np.array_equal(scan.points, right.points)
    truth = astray.ground_truth(7).boxes.centers
    assert np.array_equal(truth, world.ground_truth(7).boxes.centers)
    assert body_of(astray, "R2") == body_of(world, "R2")
    assert comm_range_of(astray) == comm_range_of(world)
    assert np.abs(np.diff([astray.pose("R1", n).x for n in range(200)])).max() < 0.2


def test_a_process_opens_its_world_with_the_errors_that_it_is_told() -> None:
    settings = ProcessSettings(world_rings=16, pose_error_m=0.5)
    with open_world_of(settings, "robot", "R1") as world:
        assert isinstance(world, Mislocalised)
    with open_world_of(ProcessSettings(world_rings=16), "robot", "R1") as world:
        assert not isinstance(world, Mislocalised)


@pytest.mark.parametrize("told", ["-0.1", "11", "nan", "much"])
def test_errors_that_cannot_be_are_refused(told: str) -> None:
    with pytest.raises(SettingError, match="POSE_ERROR_M"):
        load(ProcessSettings, {"COADAPT_POSE_ERROR_M": told})
