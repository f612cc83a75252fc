"""Scans kept on disk are the computed ones, or are computed again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from worlds.cache import ScanCache
from worlds.factory.rays import rays
from worlds.factory.world import FactoryWorld

NAME = f"v{3 if rays() is None else 4}-floor-s1-r16-n6-R1-0003"


@pytest.fixture
def rows() -> NDArray[np.float32]:
    points, actors = np.ones((5, 3)), np.arange(-1, 4)
    return np.column_stack([points, actors]).astype(np.float32)


def test_a_kept_scan_is_the_computed_one(tmp_path: Path) -> None:
    computed = FactoryWorld(rings=16)
    FactoryWorld(rings=16, cache=tmp_path).scan("R1", 3)
    assert [path.name for path in tmp_path.iterdir()] == [f"{NAME}.npy"]
    kept = FactoryWorld(rings=16, cache=tmp_path).scan_with_actors("R1", 3)
    expected = computed.scan_with_actors("R1", 3)
    assert np.array_equal(kept[0].points, expected[0].points)
    assert np.array_equal(kept[1], expected[1])
    assert kept[0].pose == expected[0].pose


def test_a_kept_scan_is_read_not_computed(tmp_path: Path, rows: NDArray[np.float32]) -> None:
    ScanCache(tmp_path).write(NAME, rows)
    kept = FactoryWorld(rings=16, cache=tmp_path).scan("R1", 3)
    assert np.array_equal(kept.points, rows[:, :3])


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "other", "pickle"])
def test_a_damaged_file_is_computed_again_and_mended(tmp_path: Path, damage: str) -> None:
    FactoryWorld(rings=16, cache=tmp_path).scan("R2", 8)
    (file,) = tmp_path.iterdir()
    whole = bytearray(file.read_bytes())
    damaged: bytes = {
        "cut": bytes(whole[:1000]),
        "flip": bytes(whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:]),
        "empty": b"",
        "other": b"not a scan at all",
        "pickle": b"\x80\x04N." + bytes(8),
    }[damage]
    file.write_bytes(damaged)
    again = FactoryWorld(rings=16, cache=tmp_path).scan("R2", 8)
    assert np.array_equal(again.points, FactoryWorld(rings=16).scan("R2", 8).points)
    assert file.read_bytes() == whole


def test_a_full_directory_takes_no_more(tmp_path: Path, rows: NDArray[np.float32]) -> None:
    cache = ScanCache(tmp_path, max_files=3)
    for i in range(6):
        cache.write(f"scan{i}", rows)
    assert len(list(tmp_path.iterdir())) == 3
    assert cache.read("scan0", columns=4) is not None
    assert cache.read("scan5", columns=4) is None


def test_a_directory_that_cannot_be_written_does_not_stop_the_world(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    world = FactoryWorld(rings=16, cache=blocked / "cache")
    assert len(world.scan("R1", 0).points) > 0
