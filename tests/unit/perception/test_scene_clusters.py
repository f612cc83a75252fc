"""What may be an object, and what a robot sends where the ego wants no more than that."""

from __future__ import annotations

from dataclasses import replace

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
from perception.scene.clusters import may_be_objects
from perception.scene.structure import ground_and_structure
from swarm.geometry import invert
from tests.support.shapes import Cloud, box, floor, shares_sent, turned
from worlds.registry import open_world

FACTORY = configuration("factory")
THINGS = {
    "a person": (box(0.0, 6.0, 0.4, 0.4, 0.0, 1.75), True),
    "a forklift": (turned(box(4.0, -4.0, 2.5, 1.2, 0.0, 2.1), 30.0), True),
    "a robot": (box(-4.0, 3.0, 0.9, 0.6, 0.0, 1.2), True),
    "a person beside a wall": (box(5.0, 7.2, 0.4, 0.4, 0.0, 1.75), True),
    "the wall": (box(-8.0, 8.0, 16.0, 0.3, 0.0, 4.0), False),
    "a pallet": (box(8.0, 3.0, 1.2, 0.8, 0.0, 0.5), False),
    "a low wall": (box(-10.0, -9.0, 8.0, 0.3, 0.0, 1.2), False),
    "a machine": (box(-9.0, -2.0, 4.0, 2.5, 0.0, 2.0), False),
    "the robot itself": (box(-0.3, -0.3, 0.6, 0.6, 0.0, 1.2), False),
}


@pytest.mark.parametrize("compiled", [True, False])
def test_an_object_is_neither_too_large_nor_too_low_nor_too_tall(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if compiled and library.places() is None:
        pytest.skip("perception was installed without a compiler")
    if not compiled:
        monkeypatch.setattr(fast, "places", lambda: None)
    clouds = [floor(), *(cloud for cloud, _ in THINGS.values())]
    cloud = np.concatenate(clouds)
    ground, structure = ground_and_structure(cloud, FACTORY.tallest_m)
    found = may_be_objects(cloud, structure, FACTORY.limits)
    ends = np.cumsum([len(cloud) for cloud in clouds])
    assert not found[: ends[0]].any()
    for (name, (_, is_one)), begin, end in zip(THINGS.items(), ends, ends[1:], strict=False):
        share = found[begin:end][~ground[begin:end]].mean()
        assert share == pytest.approx(1.0 if is_one else 0.0, abs=0.02), name


@pytest.mark.parametrize(
    "cloud",
    [
        np.zeros((0, 3), np.float32),
        np.zeros((1, 3), np.float32),
        np.full((50, 3), 500.0, np.float32),
    ],
    ids=["nothing", "one point", "beyond reach"],
)
def test_little_holds_nothing_without_an_error(cloud: Cloud) -> None:
    nowhere = np.zeros(len(cloud), dtype=np.bool_)
    assert not may_be_objects(cloud, nowhere, FACTORY.limits).any()


@pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")
class TestEarly:
    def test_objects_are_sent_whole_and_nothing_else(self) -> None:
        world = open_world("factory", robots=8, seed=1_955_001)
        early = make_fusion("early", "factory")
        assert isinstance(early, PointForm)
        scan, truth = world.scan("R2", 40), world.ground_truth(40).boxes
        usual = early.encode(scan.points, EncodeOptions())
        few = early.encode(scan.points, EncodeOptions(objects_only=True))
        (payload, places), (_, same) = take_outline(few), take_outline(usual)
        assert len(few) < 0.8 * len(usual)
        # Where it stands is told as well as ever.
        assert places.tolist() == same.tolist()
        sent = early.read(payload)
        standing = scan.points[fast.heights(scan.points) > fast.GROUND_BAND_M]
        here = truth.transformed(invert(scan.pose.matrix()))
        shown = shares_sent(standing, sent, here, 30)
        assert len(shown) >= 3
        assert np.mean(shown) > 0.9

    def test_places_and_everything_are_sent_as_ever(self) -> None:
        world = open_world("factory", robots=4, seed=1_955_002)
        early = make_fusion("early", "factory")
        scan = world.scan("R2", 10)
        everything = EncodeOptions(keep_ground=True)
        assert early.encode(scan.points, replace(everything, objects_only=True)) == early.encode(
            scan.points, everything
        )

    @pytest.mark.skipif(not has_weights("road"), reason="no weights: make train CONFIG=road")
    def test_on_the_road_a_robot_sends_all_the_same(self) -> None:
        world = open_world("road", robots=3, seed=1_955_003)
        early = make_fusion("early", "road")
        scan = world.scan("R2", 5)
        assert early.encode(scan.points, EncodeOptions(objects_only=True)) == early.encode(
            scan.points, EncodeOptions()
        )
