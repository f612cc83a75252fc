"""What peers are given is what we are given, and what is told about them is sound."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from options.opencood.clouds import network_cloud
from options.opencood.config import read_config
from research.benchmarks.intervals import ratio_of_medians, share_interval
from research.benchmarks.peers import coadapt_scene, opencood
from swarm.geometry import Pose
from tests.support.opencood_models import padded_voxels, scan, settings, write_model
from worlds.opv2v import carla


def test_a_share_of_none_is_still_uncertain() -> None:
    # The rule of three: 3.69 / n for 95 % on two sides.
    low, high = share_interval(0, 160)
    assert low == 0.0
    assert high == pytest.approx(3.69 / 160, rel=0.02)
    assert share_interval(160, 160) == (pytest.approx(1 - high), 1.0)


def test_a_ratio_lies_in_its_interval_and_load_on_both_does_not_widen_it() -> None:
    rng = np.random.default_rng(3)
    load = rng.uniform(1.0, 5.0, 60)
    ratio, (low, high) = ratio_of_medians(list(2.0 * load), list(10.0 * load))
    assert (ratio, low, high) == (0.2, 0.2, 0.2)
    ratio, (low, high) = ratio_of_medians(list(2.0 * load), list(10.0 * rng.permutation(load)))
    assert low < ratio < high


def test_a_pose_leads_to_opencood_and_back() -> None:
    pose = Pose(12.0, -3.0, 1.9, 0.02, -0.03, 2.5)
    found = carla.pose(*opencood.lidar_pose(pose))
    np.testing.assert_allclose(found.matrix(), pose.matrix(), atol=1e-9)


def test_opencood_is_given_the_points_that_our_reader_of_its_models_makes() -> None:
    points = scan(1) + np.float32(4.0)  # None on the sensor's own vehicle, which it removes itself.
    points = points[np.hypot(points[:, 0], points[:, 1]) > 4.0]
    ours = np.concatenate(list(network_cloud(points)))
    np.testing.assert_allclose(opencood.left_handed(points), ours, atol=1e-6)


def test_the_stand_in_fills_voxels_as_a_voxel_generator_does(tmp_path: Path) -> None:
    config = read_config(write_model(tmp_path, settings()))
    cloud = np.concatenate(list(network_cloud(scan(2))))
    low, high = np.array(config.lidar_range[:3]), np.array(config.lidar_range[3:])
    cloud = cloud[((cloud[:, :3] > low) & (cloud[:, :3] < high)).all(axis=1)]
    voxels = opencood.Voxels(
        voxel_size=list(config.voxel_size),
        point_cloud_range=list(config.lidar_range),
        max_num_points=config.max_points,
        max_voxels=config.max_voxels,
    )
    found = _by_cell(*voxels.generate(cloud))
    expected = _by_cell(*padded_voxels(cloud, config))
    assert found.keys() == expected.keys()
    for cell, members in expected.items():
        np.testing.assert_array_equal(found[cell], members)


def _by_cell(voxels: Any, cells: Any, counts: Any) -> dict[tuple[int, ...], Any]:
    return {
        tuple(cell): voxel[:count]
        for voxel, cell, count in zip(voxels, cells.tolist(), counts.tolist(), strict=True)
    }


def test_a_peer_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for peer in (opencood, coadapt_scene):
        monkeypatch.delenv(peer.VARIABLE, raising=False)
        assert peer.VARIABLE in (peer.why_not() or "")
        monkeypatch.setenv(peer.VARIABLE, "/nowhere")
        assert "/nowhere" in (peer.why_not() or "")
    figures, _ = opencood.ratios()
    assert figures["ratio_opencood_early"] is None
    assert "/nowhere" in figures["opencood_missing"]
