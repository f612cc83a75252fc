"""The intermediate algorithms with the weights that come with the project, on the simulated
factory; nothing here depends on how good the weights are, but that they find what is plain."""

from __future__ import annotations

import math
import sys
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from perception.boxes import iou_bev
from perception.codec.envelope import seal, unseal
from perception.codec.features import CellBlock, decode_cells
from perception.codec.outlined import add_outline, take_outline
from perception.detector.learned import Detector
from perception.detector.network import FEATURES
from perception.detector.weight_files import has_weights, weight_file
from perception.fusion import algorithms
from perception.fusion.algorithms.intermediate_sparse import (
    BLOCK,
    DOUBT,
    SURE,
    IntermediateSparse,
)
from perception.fusion.base import Contribution, EncodeOptions, Fusion
from perception.fusion.detectors import shared_detector
from perception.fusion.feature_fusion import Fuse
from perception.fusion.known import bodies
from perception.fusion.maps import SentMap, attend, strongest
from perception.fusion.registry import fusion_names, make_fusion
from perception.types import Boxes
from swarm.errors import PayloadError, PerceptionError
from swarm.geometry import Points, Pose, invert
from worlds.base import Scan
from worlds.cooperative.fusing import fuse_frame
from worlds.factory.world import FactoryWorld

pytestmark = pytest.mark.skipif(
    not has_weights("factory"), reason=f"no weights {weight_file('factory').name}: make train"
)
NAMES = ("intermediate", "intermediate-codebook", "intermediate-max", "intermediate-sparse")
THIN = ("intermediate-codebook", "intermediate-sparse")
EVERY = pytest.mark.parametrize("name", NAMES)
SPARSE_BYTES = 8_000


@pytest.fixture(scope="module")
def world() -> FactoryWorld:
    return FactoryWorld(robots=4, seed=1_000_003)


@pytest.fixture(scope="module")
def scans(world: FactoryWorld) -> dict[str, Scan]:
    return {robot: world.scan(robot, 120) for robot in world.robots}


@pytest.fixture(scope="module")
def detector() -> Detector:
    return shared_detector("factory")


def payload_of(fusion: Fusion, scan: Scan, reference: Pose, demand: bytes = b"") -> bytes:
    return fusion.encode(
        scan.points, EncodeOptions(pose=scan.pose, reference=reference, demand=demand)
    )


def contribution(fusion: Fusion, scans: dict[str, Scan], robot: str) -> Contribution:
    """What a robot sends to R1."""
    scan = scans[robot]
    return Contribution(robot, payload_of(fusion, scan, scans["R1"].pose), scan.pose.matrix())


def same(a: Boxes, b: Boxes) -> bool:
    return (
        np.array_equal(a.centers, b.centers)
        and np.array_equal(a.sizes, b.sizes)
        and np.array_equal(a.headings, b.headings)
        and np.array_equal(a.scores, b.scores)
        and a.labels == b.labels
    )


def cells(detector: Detector, payload: bytes) -> CellBlock:
    book = detector.codebook
    payload, _ = take_outline(payload)
    return decode_cells(payload, detector.version, detector.config.cells, FEATURES, len(book))


@EVERY
def test_two_robots_are_fused(name: str, world: FactoryWorld) -> None:
    assert name in fusion_names("factory")
    fused = fuse_frame(world, 120, "R1", ("R1", "R2"), name)
    assert fused.rejected == {}
    assert list(fused.bytes) == ["R2"]
    # Neither the sender nor the ego is a detection; the sender is known, at its place.
    places = fused.boxes.centers[:, :2]
    for pose in (world.pose(robot, 120) for robot in ("R1", "R2")):
        assert np.hypot(*(places - (pose.x, pose.y)).T).min() > 0.3
    assert [one.robot for one in fused.known] == ["R2", "R3", "R4"]
    other = world.pose("R2", 120)
    assert bodies(fused.known).centers[0, :2] == pytest.approx([other.x, other.y])
    assert ((fused.boxes.scores >= 0) & (fused.boxes.scores <= 1)).all()
    assert np.isfinite(fused.boxes.centers).all()


@EVERY
def test_a_frame_is_fused_the_same_each_time(name: str, world: FactoryWorld) -> None:
    first, second = (fuse_frame(world, 120, "R1", ("R2",), name) for _ in range(2))
    assert first.bytes == second.bytes
    assert same(first.boxes, second.boxes)


def bad_payloads(fusion: Fusion, scans: dict[str, Scan]) -> dict[str, bytes]:
    """Payloads that R1 cannot use, by what is wrong with them."""
    ego, scan = scans["R1"].pose, scans["R3"]
    good = payload_of(fusion, scan, ego)
    inner, places = take_outline(good)
    kind, body = unseal(inner)

    def altered(raw: bytes) -> bytes:
        return add_outline(seal(kind, raw), places)

    other = "intermediate" if fusion.name == "intermediate-codebook" else "intermediate-codebook"
    return {
        "weights": altered(bytes((body[0] ^ 1,)) + body[1:]),
        "around": payload_of(fusion, scan, replace(ego, x=ego.x + 1.0)),
        "around ": payload_of(fusion, scan, replace(ego, yaw=ego.yaw + 0.05)),
        "around  ": fusion.encode(scan.points, EncodeOptions(pose=scan.pose)),
        "form": payload_of(make_fusion(other, "factory"), scan, ego),
        "kind": payload_of(make_fusion("early", "factory"), scan, ego),
        "checksum": good[:-20] + good[-19:],
        "checksum ": good[: len(good) // 2],
        "decompress": altered(body[: len(body) - 9]),
        "outline": inner,
        "bytes": b"",
    }


@EVERY
def test_what_cannot_be_used_costs_its_sender_alone(name: str, scans: dict[str, Scan]) -> None:
    fusion = make_fusion(name, "factory")
    own, ego = scans["R1"].points, scans["R1"].pose.matrix()
    good = contribution(fusion, scans, "R2")
    bad_pose = scans["R3"].pose.matrix()
    bad = [
        Contribution(why, payload, bad_pose) for why, payload in bad_payloads(fusion, scans).items()
    ]
    expected = fusion.fuse(own, ego, [good])
    assert expected.rejected == {}
    result = fusion.fuse(own, ego, [*bad[:5], good, *bad[5:]])
    assert list(result.rejected) == [item.robot for item in bad]
    assert all(why.strip() in text for why, text in result.rejected.items())
    assert same(result.boxes, expected.boxes)


@EVERY
def test_the_order_of_arrival_does_not_matter(name: str, scans: dict[str, Scan]) -> None:
    fusion = make_fusion(name, "factory")
    own, ego = scans["R1"].points, scans["R1"].pose.matrix()
    helpers = [contribution(fusion, scans, robot) for robot in ("R2", "R3", "R4")]
    first = fusion.fuse(own, ego, helpers).boxes
    second = fusion.fuse(own, ego, helpers[::-1]).boxes
    # The weakest may be cut differently where rounding is all that ranks them.
    for one, other in ((first, second), (second, first)):
        sure = one.take(one.scores > 0.3)
        assert len(sure) > 0
        assert iou_bev(sure, other).max(axis=1).min() > 0.95


def test_headings_that_differ_by_whole_turns_are_one_reference(scans: dict[str, Scan]) -> None:
    fusion = make_fusion("intermediate-sparse", "factory")
    ego, scan = scans["R1"], scans["R2"]
    for turns in (-1, 1):
        turned = replace(ego.pose, yaw=ego.pose.yaw + turns * math.tau)
        item = Contribution("R2", payload_of(fusion, scan, turned), scan.pose.matrix())
        assert fusion.fuse(ego.points, ego.pose.matrix(), [item]).rejected == {}


@EVERY
def test_far_from_the_worlds_origin_the_result_is_the_same(
    name: str, scans: dict[str, Scan]
) -> None:
    fusion = make_fusion(name, "factory")
    found = []
    for away in (0.0, 5000.0):
        poses = {k: replace(s.pose, x=s.pose.x + away) for k, s in scans.items()}
        scan = replace(scans["R2"], pose=poses["R2"])
        item = Contribution("R2", payload_of(fusion, scan, poses["R1"]), scan.pose.matrix())
        result = fusion.fuse(scans["R1"].points, poses["R1"].matrix(), [item])
        assert result.rejected == {}
        found.append(result.boxes.take(result.boxes.scores > 0.3))
    found[1].centers[:, 0] -= 5000.0
    assert iou_bev(found[0], found[1]).max(axis=1).min() > 0.9


@pytest.mark.parametrize("name", THIN)
def test_few_cells_take_few_bytes(name: str, world: FactoryWorld, scans: dict[str, Scan]) -> None:
    dense = len(contribution(make_fusion("intermediate", "factory"), scans, "R2").payload)
    fused = fuse_frame(world, 120, "R1", world.robots, name)
    assert len(fused.bytes) == 3
    assert max(fused.bytes.values()) <= SPARSE_BYTES
    assert max(fused.bytes.values()) < dense


def test_dense_payloads_hold_every_cell(detector: Detector, scans: dict[str, Scan]) -> None:
    for name in ("intermediate", "intermediate-max"):
        sent = contribution(make_fusion(name, "factory"), scans, "R2").payload
        assert cells(detector, sent).present.all()


def test_what_is_sent_is_the_map_within_half_a_step(
    detector: Detector, scans: dict[str, Scan]
) -> None:
    scan = scans["R2"]
    features = detector.encode(scan.points).numpy()
    for name in ("intermediate", "intermediate-sparse"):
        sent = cells(detector, payload_of(make_fusion(name, "factory"), scan, scan.pose))
        apart = np.abs(sent.values / 15 - features[:, sent.present])
        # The points are turned into the frame they are in already, which rounds them.
        assert np.quantile(apart, 0.999) < 0.5 / 15 + 1e-3


@pytest.mark.parametrize(("detector", "fuse"), [("factory", strongest), ("road", attend)])
@pytest.mark.parametrize("name", THIN)
def test_chosen_cells_are_fused_as_suits_the_detector(detector: str, fuse: Fuse, name: str) -> None:
    fusion = make_fusion(name, detector)
    assert isinstance(fusion, IntermediateSparse)
    shape = fusion.detector.config.cells
    own, other = torch.rand(2, FEATURES, *shape)
    here = torch.ones(2, *shape, dtype=torch.bool)
    joined = fusion.join(own, [SentMap(other, here[1])])
    assert torch.allclose(joined, fuse(torch.stack([own, other]), here), atol=1e-6)


def sparse() -> IntermediateSparse:
    fusion = make_fusion("intermediate-sparse", "factory")
    assert isinstance(fusion, IntermediateSparse)
    return fusion


def test_the_demand_is_for_blocks_of_which_the_ego_is_not_sure(
    detector: Detector, scans: dict[str, Scan]
) -> None:
    fusion = sparse()
    own = detector.encode(scans["R1"].points)
    wanted = fusion.wanted(fusion.demand(own))
    chance = detector.look(own)[0].numpy()
    assert wanted.shape == chance.shape == detector.config.cells
    for row in range(0, chance.shape[0], BLOCK):
        for column in range(0, chance.shape[1], BLOCK):
            block = np.s_[row : row + BLOCK, column : column + BLOCK]
            seen = chance[block]
            sure = seen.max() >= SURE and not ((seen > DOUBT) & (seen < SURE)).any()
            assert (wanted[block] == (not sure)).all()


def test_no_demand_is_a_demand_for_everything() -> None:
    assert sparse().wanted(b"").all()


def half(fusion: IntermediateSparse) -> bytes:
    """A demand for every second block."""
    rows, columns = fusion.detector.config.cells
    bits = np.zeros((-(-rows // BLOCK), -(-columns // BLOCK)), dtype=np.bool_)
    bits[::2, ::2] = bits[1::2, 1::2] = True
    return zlib.compress(np.packbits(bits).tobytes())


@pytest.mark.parametrize("name", THIN)
def test_cells_that_nobody_asked_for_are_not_sent(
    name: str, detector: Detector, scans: dict[str, Scan]
) -> None:
    fusion = make_fusion(name, "factory")
    assert isinstance(fusion, IntermediateSparse)
    demand = half(fusion)
    wanted = fusion.wanted(demand)
    assert wanted.mean() == 0.5
    everything, asked = (
        cells(detector, payload_of(fusion, scans["R2"], scans["R1"].pose, text)).present
        for text in (b"", demand)
    )
    assert 0 < asked.sum() <= fusion.max_cells
    assert not (asked & ~wanted).any()
    assert (everything & ~wanted).any()
    nothing = zlib.compress(bytes(len(zlib.decompress(demand))))
    silent = payload_of(fusion, scans["R2"], scans["R1"].pose, nothing)
    assert cells(detector, silent).values.shape[1] == 0
    item = Contribution("R2", silent, scans["R2"].pose.matrix())
    own, ego = scans["R1"].points, scans["R1"].pose.matrix()
    assert fusion.fuse(own, ego, [item]).rejected == {}


@pytest.mark.parametrize(
    "demand", [b"x", zlib.compress(b""), zlib.compress(bytes(1000)), zlib.compress(bytes(33))[:-3]]
)
def test_a_demand_that_cannot_be_read_is_refused(demand: bytes, scans: dict[str, Scan]) -> None:
    with pytest.raises(PayloadError, match="demand"):
        payload_of(sparse(), scans["R2"], scans["R1"].pose, demand)


def test_cells_around_the_likeliest_middles_are_sent_first() -> None:
    fusion = sparse()
    rows, columns = fusion.detector.config.cells
    everywhere = np.ones((rows, columns), dtype=np.bool_)
    chance = np.random.default_rng(1).random((rows, columns), dtype=np.float32)
    assert fusion.select(chance, everywhere).sum() == fusion.max_cells
    few = np.zeros((rows, columns), dtype=np.float32)
    few[3, 5], few[30, 60], few[90, 90] = 0.5, 0.03, 0.0001
    chosen = np.argwhere(fusion.select(few, everywhere)).tolist()
    sure = [[row, column] for row in range(1, 6) for column in range(3, 8)]
    assert sorted(chosen) == [*sure, [30, 60]]
    # Where there is room for few, the middles go first.
    few[10:40, 10:110:5] = 0.4
    dense = fusion.select(few, everywhere)
    assert dense.sum() == fusion.max_cells
    assert dense[10:40, 10:110:5].sum() >= 599


def strange_clouds() -> dict[str, Points]:
    nan = np.full((50, 3), np.nan, dtype=np.float32)
    nan[::7, 1] = 1.0
    rng = np.random.default_rng(0)
    away = rng.uniform(30, 1000, (500, 3)).astype(np.float32)
    return {
        "empty": np.zeros((0, 3), dtype=np.float32),
        "one": np.array([[3.0, 1.0, 0.0]], dtype=np.float32),
        "nan": nan,
        "infinite": np.full((5, 3), np.inf, dtype=np.float32),
        "outside": away,
        "astray": np.array([[1e18, -1e18, 0.0]], dtype=np.float32),
    }


def finite(boxes: Boxes) -> bool:
    return all(np.isfinite(c).all() for c in (boxes.centers, boxes.sizes, boxes.scores))


@EVERY
def test_strange_clouds_of_robots_spoil_nothing(name: str, scans: dict[str, Scan]) -> None:
    fusion = make_fusion(name, "factory")
    items = []
    for number, points in enumerate(strange_clouds().values()):
        # Each in a place of its own, outside the floor.
        pose = replace(scans["R2"].pose, x=200.0 + 10 * number)
        scan = replace(scans["R2"], points=points, pose=pose)
        payload = payload_of(fusion, scan, scans["R1"].pose)
        items.append(Contribution(f"S{number}", payload, pose.matrix()))
    good = contribution(fusion, scans, "R3")
    result = fusion.fuse(scans["R1"].points, scans["R1"].pose.matrix(), [*items, good])
    assert result.rejected == {}
    assert finite(result.boxes)
    without = fusion.fuse(scans["R1"].points, scans["R1"].pose.matrix(), [good])
    sure = without.boxes.take(without.boxes.scores > 0.5)
    assert len(sure)
    assert (iou_bev(sure, result.boxes).max(axis=1) > 0.8).all()


@EVERY
def test_strange_clouds_of_the_ego_leave_it_what_others_see(
    name: str, scans: dict[str, Scan]
) -> None:
    fusion = make_fusion(name, "factory")
    good = contribution(fusion, scans, "R3")
    for cloud in ("empty", "one", "nan", "outside"):
        gathering = fusion.begin(strange_clouds()[cloud], scans["R1"].pose.matrix())
        gathering.ask()
        gathering.add(good)
        found = gathering.finish()
        assert finite(found)
        assert (found.scores > 0.5).any()


@EVERY
def test_a_cloud_that_is_none_is_refused(name: str, scans: dict[str, Scan]) -> None:
    fusion = make_fusion(name, "factory")
    flat = np.zeros((5, 2), dtype=np.float32)
    with pytest.raises(PerceptionError, match=r"shape \(N, 3\)"):
        fusion.encode(flat, EncodeOptions())
    with pytest.raises(PerceptionError, match=r"shape \(N, 3\)"):
        fusion.fuse(flat, scans["R1"].pose.matrix(), [])


def test_the_weights_find_forklifts_in_the_open(world: FactoryWorld, detector: Detector) -> None:
    found = []
    for robot, frame in (("R1", 300), ("R3", 480), ("R3", 720), ("R1", 840), ("R1", 2340)):
        scan, actors = world.scan_with_actors(robot, frame)
        truth = world.actors(frame)[0].transformed(invert(scan.pose.matrix()))
        hits = np.bincount(actors[actors >= 0], minlength=len(truth))
        distance = np.hypot(*truth.centers[:, :2].T)
        plain = (hits >= 400) & (distance > 7) & (distance < 10)
        plain &= np.array([label == "forklift" for label in truth.labels])
        assert plain.any()
        boxes = detector.detect(scan.points)
        forklifts = boxes.take(np.array([label == "forklift" for label in boxes.labels]))
        found += list(iou_bev(truth.take(plain), forklifts).max(axis=1, initial=0.0) > 0.3)
    assert np.mean(found) > 0.7


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An algorithm that somebody else wrote, in a folder of their own."""
    (tmp_path / "twice.py").write_text(
        '''
from perception.fusion.algorithms.late import LateFusion
from perception.fusion.detectors import shared_finder


class Twice(LateFusion):
    """Boxes, twice as sure."""

    name = "twice"


def fusion(detector):
    return Twice(shared_finder(detector))
'''
    )
    monkeypatch.setattr(algorithms, "__path__", [*algorithms.__path__, str(tmp_path)])
    yield "twice"
    sys.modules.pop(f"{algorithms.__name__}.twice", None)
    vars(algorithms).pop("twice", None)


def test_who_adds_a_file_adds_an_algorithm(added: str, world: FactoryWorld) -> None:
    assert added in fusion_names("factory")
    assert make_fusion(added, "factory").name == added
    fused = fuse_frame(world, 120, "R1", ("R2",), added)
    assert fused.rejected == {}
    assert len(fused.boxes) > 0


def test_an_algorithm_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(PerceptionError, match=r"'twice' is not available.*intermediate-max"):
        make_fusion("twice", "factory")
