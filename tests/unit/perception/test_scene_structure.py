"""Walls and racks are told from objects, and sent in a few directions only."""

from __future__ import annotations

import numpy as np
import pytest

from perception.codec.outlined import take_outline
from perception.detector.config import configuration
from perception.detector.weight_files import has_weights
from perception.fusion.base import EncodeOptions
from perception.fusion.one_pass import PointForm
from perception.fusion.registry import make_fusion
from perception.kernels import library
from perception.scene import fast
from perception.scene.structure import ground_and_structure, in_sectors
from swarm.geometry import invert
from tests.support.shapes import Cloud, box, floor, shares_sent, turned
from worlds.registry import open_world

FACTORY = configuration("factory")
FORKLIFT = box(4.0, -4.0, 2.5, 1.2, 0.0, 2.1)
PERSON = box(0.0, 7.2, 0.4, 0.4, 0.0, 1.75)
THINGS = {
    "a wall": (box(-8.0, 8.0, 16.0, 0.3, 0.0, 4.0), True),
    "a pillar": (box(9.0, 2.0, 0.5, 0.5, 0.0, 4.4), True),
    "a low wall": (box(-10.0, -9.0, 8.0, 0.3, 0.0, 1.0), False),
    "a person beside the wall": (PERSON, False),
    "a forklift": (FORKLIFT, False),
    "a person beside it": (box(3.4, -4.0, 0.4, 0.4, 0.0, 1.75), False),
    **{
        f"a forklift at {a}": (turned(FORKLIFT + np.array([-9, a / 9, 0], np.float32), a), False)
        for a in (30, 45, 70)
    },
}


@pytest.mark.parametrize("compiled", [True, False])
def test_what_is_taller_than_any_object_is_structure(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if compiled and library.places() is None:
        pytest.skip("perception was installed without a compiler")
    if not compiled:
        monkeypatch.setattr(fast, "places", lambda: None)
    clouds = [floor(), *(cloud for cloud, _ in THINGS.values())]
    ground, structure = ground_and_structure(np.concatenate(clouds), FACTORY.tallest_m)
    assert not (ground & structure).any()
    ends = np.cumsum([len(cloud) for cloud in clouds])
    assert ground[: ends[0]].all()
    for (name, (_, is_structure)), begin, end in zip(THINGS.items(), ends, ends[1:], strict=False):
        share = structure[begin:end][~ground[begin:end]].mean()
        assert share == pytest.approx(1.0 if is_structure else 0.0, abs=0.02), name


@pytest.mark.parametrize("thing", [FORKLIFT, PERSON], ids=["forklift", "person"])
def test_what_stands_under_something_is_no_structure(thing: Cloud) -> None:
    x, y = thing[:, :2].min(axis=0) - 1.0
    above = box(x, y, 5.0, 4.0, 4.2, 4.4)
    _, structure = ground_and_structure(np.concatenate([floor(), thing, above]), FACTORY.tallest_m)
    assert not structure[len(floor()) : -len(above)].any()


@pytest.mark.parametrize(
    "cloud",
    [
        np.zeros((0, 3), np.float32),
        np.zeros((1, 3), np.float32),
        np.full((5, 3), 500.0, np.float32),
        np.array([[1.0, 1.0, z] for z in (0.0, 1.0, 2.0, 3.0, 4.0)], np.float32),
    ],
    ids=["nothing", "one point", "beyond reach", "a column of few"],
)
def test_little_is_split_without_an_error(cloud: Cloud) -> None:
    ground, structure = ground_and_structure(cloud, FACTORY.tallest_m)
    assert ground.shape == structure.shape == (len(cloud),)


def test_directions_in_which_structure_is_kept_lie_evenly_around() -> None:
    azimuth = np.linspace(0.0, 2.0 * np.pi, 4096, endpoint=False)
    ring = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(4096)]).astype(np.float32)
    kept = in_sectors(9.0 * ring)
    assert kept.mean() == pytest.approx(1 / 8, abs=0.01)
    assert kept.reshape(64, -1).any(axis=1).all()


@pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")
def test_early_sends_objects_whole_and_little_of_what_is_none() -> None:
    world = open_world("factory", robots=8, seed=1_955_001)
    early = make_fusion("early", "factory")
    assert isinstance(early, PointForm)
    scan, truth = world.scan("R2", 40), world.ground_truth(40).boxes
    sent = early.read(take_outline(early.encode(scan.points, EncodeOptions()))[0])
    whole = early.read(take_outline(early.encode(scan.points, EncodeOptions(keep_ground=True)))[0])
    heights = fast.heights(scan.points)
    standing = scan.points[heights > fast.GROUND_BAND_M]
    assert len(sent) < 0.8 * len(standing) < len(whole)
    here = truth.transformed(invert(scan.pose.matrix()))
    shown = shares_sent(standing, sent, here, 10)
    assert len(shown) >= 3
    assert np.mean(shown) > 0.95
