"""What poses err by: anew in each frame, drifting, or fixed."""

from __future__ import annotations

import numpy as np
import pytest

from swarm.geometry import Pose
from worlds.cooperative.fusing import DRIFT_FRAMES, PoseErrors, disturbed

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
