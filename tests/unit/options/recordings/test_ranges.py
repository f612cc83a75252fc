"""Scans as range images: to the last bit, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from options.recordings import format as layout
from options.recordings.file import RecordingFile
from options.recordings.format import Header, Ranges
from options.recordings.ranges import for_view, put_rays, put_scan, take_rays, take_scan
from options.recordings.world import RecordingWorld
from swarm.errors import WorldError
from swarm.geometry import Points
from tests.support.recording_files import write_recording
from worlds.base import Rays
from worlds.factory.world import FactoryWorld


@pytest.fixture(scope="module")
def factory() -> FactoryWorld:
    return FactoryWorld(robots=2, rings=32)


def recorded(points: Points, rays: Rays) -> Ranges:
    found = put_scan(points, rays)
    assert found is not None
    return found


def test_a_scan_comes_back_to_the_last_bit_in_less_than_a_byte_a_point(
    factory: FactoryWorld,
) -> None:
    rays = take_rays(put_rays(factory.rays()))
    for frame in (0, 7, 300):
        points = factory.scan("R1", frame).points
        packed = recorded(points, factory.rays())
        assert take_scan(packed, rays).tobytes() == points.tobytes()
        assert len(msgspec.json.encode(packed)) < 1.2 * len(points), "base64 included"


@pytest.mark.parametrize(
    "change",
    [
        lambda points: points[::-1],
        lambda points: points + np.float32(1e-6),
        lambda points: points * np.float32(4000),
        lambda points: points[:0],
        lambda points: np.concatenate([points, points[-1:]]),
        lambda points: np.zeros_like(points),
    ],
    ids=["another order", "a bit more", "far", "none", "one twice", "in the sensor"],
)
def test_a_cloud_that_is_no_range_image_is_left_to_the_whole_form(
    factory: FactoryWorld,
    change: Callable[[Points], Points],
) -> None:
    points = np.ascontiguousarray(change(factory.scan("R1", 0).points))
    assert put_scan(points, factory.rays()) is None


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"low": b"no zlib"}, "damaged"),
        ({"present": put_scan}, "hold"),
        ({"points": 3}, "3 points has"),
    ],
)
def test_damaged_ranges_are_an_error(
    factory: FactoryWorld, changed: dict[str, object], words: str
) -> None:
    packed = recorded(factory.scan("R1", 0).points, factory.rays())
    if callable(changed.get("present")):
        changed = {"present": packed.low}
    with pytest.raises(WorldError, match=words):
        take_scan(msgspec.structs.replace(packed, **changed), factory.rays())


def test_a_sensor_of_too_many_rays_is_an_error(factory: FactoryWorld) -> None:
    rays = msgspec.structs.replace(put_rays(factory.rays()), rings=2**15)
    with pytest.raises(WorldError, match="33554432 rays"):
        take_rays(rays)


def test_viewers_get_some_points_of_everything(factory: FactoryWorld) -> None:
    points = factory.scan("R1", 0).points
    shown = for_view(points)
    assert len(points) / 8 < len(shown) < len(points) / 4
    gaps = np.abs(points[:, None, :2] - shown[None, ::40, :2]).max(axis=2)
    assert gaps.min(axis=0).max() <= 1 / 32 + 1e-6
    assert not len(for_view(points[:0]))


def test_a_recording_of_before_ranges_still_gives_its_scans(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def first(**facts: object) -> Header:
        return Header(version=1, **facts)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(FactoryWorld, "rays", lambda world: None)
        patch.setattr(layout, "Header", first)
        path = write_recording(tmp_path / "old.mcap", (40,), robots=2)
    file = RecordingFile(path)
    assert file.header.version == 1
    assert not any(topic.endswith("/ranges") for topic in file.topics)
    expected = FactoryWorld(robots=2, rings=16).scan("R2", 40).points
    assert RecordingWorld(path).scan("R2", 0).points.tobytes() == expected.tobytes()


def test_viewers_get_every_point_where_that_is_asked_for(tmp_path: Path) -> None:
    small = write_recording(tmp_path / "small.mcap", (40,), robots=2)
    whole = write_recording(tmp_path / "whole.mcap", (40,), robots=2, whole=True)
    assert "/robot/R2/ranges" not in RecordingFile(whole).topics
    shown, expected = (RecordingWorld(path).scan("R2", 0).points for path in (whole, small))
    assert shown.tobytes() == expected.tobytes()
    assert whole.stat().st_size > 2 * small.stat().st_size


def test_a_recording_of_a_later_version_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        later = lambda **facts: Header(version=7, **facts)  # noqa: E731
        patch.setattr(layout, "Header", later)
        path = write_recording(tmp_path / "later.mcap", (40,), robots=2)
    with pytest.raises(WorldError, match="version 7; this program reads 1 and 2"):
        RecordingFile(path)


def test_ranges_without_their_rays_are_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_recording(tmp_path / "all.mcap", (40,), robots=2)
    world = RecordingWorld(path)
    monkeypatch.setattr(world.file, "rays", None)
    with pytest.raises(WorldError, match="lacks topic /rays"):
        world.scan("R1", 0)
