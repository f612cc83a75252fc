"""Early and late fusion, on built scenes and on the real sample."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.codec.boxes import encode_boxes
from perception.codec.outlined import add_outline, take_outline
from perception.codec.places import encode_places
from perception.codec.points import encode_points
from perception.detector import weight_files
from perception.detector.finders import Clustered
from perception.fusion.algorithms.early import MAX_POINTS, EarlyFusion
from perception.fusion.algorithms.late import LateFusion
from perception.fusion.base import Contribution, EncodeOptions
from perception.fusion.known import KnownRobot, bodies, without_known
from perception.fusion.registry import fusion_names, make_fusion
from swarm.body import Body
from swarm.errors import PerceptionError
from swarm.geometry import Points, Pose, invert, transform
from tests.unit.perception.test_boxes import make
from worlds.cooperative.fusing import SINGLE, Disturbance, fuse_frame
from worlds.cooperative.judging import tallied
from worlds.opv2v.world import Opv2vWorld

CLUSTERED = {"early": EarlyFusion(Clustered("road")), "late": LateFusion(Clustered("road"))}
"""What is built here is made of bare faces, which the detector without learning takes for cars."""
EGO = Pose(0.0, 0.0, 1.8)
OTHER = Pose(30.0, 4.0, 1.8, yaw=2.5)
CAR = np.array([15.0, 2.0])


def street(sensor: Pose, sides: tuple[str, ...]) -> Points:
    """A flat street with the named sides of one car, in the sensor's frame."""
    x, y = np.meshgrid(np.arange(-5, 40, 0.4), np.arange(-10, 15, 0.4))
    ground = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    u, z = np.meshgrid(np.arange(-1, 1.001, 0.05), np.arange(0.3, 1.5, 0.1))
    u, z = u.ravel(), z.ravel()
    faces = {
        "back": np.column_stack([np.full(u.size, -2.25), u * 0.95, z]),
        "front": np.column_stack([np.full(u.size, 2.25), u * 0.95, z]),
        "right": np.column_stack([u * 2.25, np.full(u.size, -0.95), z]),
        "left": np.column_stack([u * 2.25, np.full(u.size, 0.95), z]),
    }
    car = [faces[side] + np.append(CAR, 0.0) for side in sides]
    world = np.concatenate([ground, *car]).astype(np.float32)
    return transform(invert(sensor.matrix()), world)


@pytest.mark.parametrize("name", ["early", "late"])
def test_a_car_seen_by_both_is_one_box_at_its_place(name: str) -> None:
    fusion = CLUSTERED[name]
    payload = fusion.encode(street(OTHER, ("front", "left")), EncodeOptions())
    result = fusion.fuse(
        street(EGO, ("back", "right")), EGO.matrix(), [Contribution("B", payload, OTHER.matrix())]
    )
    assert result.rejected == {}
    near = np.hypot(*(result.boxes.centers[:, :2] - CAR).T) < 3
    assert near.sum() == 1
    box = result.boxes.take(near)
    assert np.allclose(box.centers[0, :2], CAR, atol=0.4)
    assert np.allclose(box.sizes[0, :2], [4.5, 1.9], atol=0.6)
    assert abs(np.sin(box.headings[0])) < 0.1
    assert box.labels == ("vehicle",)


@pytest.mark.parametrize("name", ["early", "late"])
@pytest.mark.parametrize("payload", [b"", b"garbage", bytes(200)])
def test_one_bad_contribution_does_not_spoil_the_rest(name: str, payload: bytes) -> None:
    fusion = CLUSTERED[name]
    own = street(EGO, ("back", "right"))
    good = fusion.encode(street(OTHER, ("front", "left")), EncodeOptions())
    alone = fusion.fuse(own, EGO.matrix(), [Contribution("good", good, OTHER.matrix())])
    both = fusion.fuse(
        own,
        EGO.matrix(),
        [
            Contribution("bad", payload, OTHER.matrix()),
            Contribution("good", good, OTHER.matrix()),
        ],
    )
    assert list(both.rejected) == ["bad"]
    assert np.array_equal(both.boxes.centers, alone.boxes.centers)


@pytest.mark.parametrize("name", ["early", "late"])
@pytest.mark.parametrize("count", [0, 1])
def test_clouds_with_nothing_in_them_are_fused(name: str, count: int) -> None:
    fusion = make_fusion(name, "factory")
    cloud = np.full((count, 3), np.nan, dtype=np.float32)
    payload = fusion.encode(cloud, EncodeOptions())
    result = fusion.fuse(cloud, EGO.matrix(), [Contribution("B", payload, OTHER.matrix())])
    assert result.rejected == {}
    assert len(result.boxes) == 0


@pytest.mark.parametrize("name", ["early", "late"])
def test_what_is_seen_of_a_sender_is_no_detection(name: str) -> None:
    # The ego sees the back of the car that carries the other sensor.
    sender = Pose(CAR[0] - 0.5, CAR[1], 1.9)
    fusion = CLUSTERED[name]
    payload = fusion.encode(street(sender, ()), EncodeOptions())
    own = street(EGO, ("back",))
    result = fusion.fuse(own, EGO.matrix(), [Contribution("B", payload, sender.matrix())])
    assert len(result.boxes) <= 1
    body = Body(label="vehicle", size=(4.5, 1.9, 1.5), center=(0.5, 0.0, -1.1))
    known = KnownRobot("B", body, sender.matrix())
    assert len(without_known(result.boxes, [known])) == 0
    assert bodies([known]).centers[0, :2] == pytest.approx(CAR)


@pytest.mark.parametrize("name", ["early", "late"])
def test_the_ego_does_not_report_itself(name: str) -> None:
    ego = Pose(CAR[0] - 0.5, CAR[1], 1.9)
    fusion = CLUSTERED[name]
    payload = fusion.encode(street(OTHER, ("front", "left")), EncodeOptions())
    result = fusion.fuse(
        street(ego, ()), ego.matrix(), [Contribution("B", payload, OTHER.matrix())]
    )
    assert len(result.boxes) == 0


def test_a_payload_with_too_many_boxes_is_refused() -> None:
    fusion = make_fusion("late", "factory")
    boxes = encode_boxes(make(*[(0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)] * 1000))
    payload = add_outline(boxes, np.zeros((0, 2)))
    nothing = np.zeros((0, 3), dtype=np.float32)
    result = fusion.fuse(nothing, EGO.matrix(), [Contribution("B", payload, OTHER.matrix())])
    assert result.rejected == {"B": "1000 boxes in one scan; allowed: 200"}
    assert len(result.boxes) == 0


def test_dropping_the_ground_makes_the_payload_smaller() -> None:
    fusion = CLUSTERED["early"]
    cloud = street(EGO, ("back", "right"))
    without = fusion.encode(cloud, EncodeOptions())
    assert len(without) < len(fusion.encode(cloud, EncodeOptions(keep_ground=True))) / 2


def test_without_weights_there_is_no_intermediate_fusion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weight_files, "_FOLDER", tmp_path)
    assert fusion_names("road") == ("early", "late")
    with pytest.raises(PerceptionError, match=r"no weights for 'road'\); allowed: early, late"):
        make_fusion("intermediate", "road")


@pytest.fixture(scope="module")
def world(opv2v_dir: Path) -> Opv2vWorld:
    return Opv2vWorld(opv2v_dir)


def test_on_real_frames_two_vehicles_find_more_than_one(world: Opv2vWorld) -> None:
    frames = range(0, 16, 3)
    single, late, early = (
        tallied(world, name, "302", frames=frames).precision().ap_50
        for name in (SINGLE, "late", "early")
    )
    assert single + 0.03 < min(late, early)
    assert early > 0.97


def test_noise_on_poses_costs_precision_and_repeats_exactly(world: Opv2vWorld) -> None:
    noisy = [
        tallied(world, "early", "302", Disturbance(pose_noise_m=0.6), range(4)).precision()
        for _ in range(2)
    ]
    assert noisy[0] == noisy[1]
    assert noisy[0].ap_70 < tallied(world, "early", "302", frames=range(4)).precision().ap_70


def test_payload_bytes_are_those_of_the_senders(world: Opv2vWorld) -> None:
    fused = fuse_frame(world, 0, "302", ("302", "311"), "late")
    assert list(fused.bytes) == ["311"]
    assert fused.bytes["311"] == len(
        make_fusion("late", "road").encode(world.scan("311", 0).points, EncodeOptions())
    )


def test_early_sends_only_what_the_ego_looks_at(world: Opv2vWorld) -> None:
    fusion, scan = make_fusion("early", "road"), world.scan("311", 0)
    whole = fusion.encode(scan.points, EncodeOptions(pose=scan.pose))
    ego = world.pose("302", 0)
    near = fusion.encode(scan.points, EncodeOptions(pose=scan.pose, reference=ego))
    far = fusion.encode(
        scan.points, EncodeOptions(pose=scan.pose, reference=replace(ego, x=ego.x + 1e4))
    )
    assert len(far) < len(near) < len(whole)
    gathering = fusion.begin(world.scan("302", 0).points, ego.matrix())
    assert gathering.ask().reference == pytest.approx(ego)
    found = []
    for payload in (near, whole):
        gathering = fusion.begin(world.scan("302", 0).points, ego.matrix())
        gathering.add(Contribution("311", payload, scan.pose.matrix()))
        found.append(gathering.finish())
    clear = [boxes.take(boxes.scores > 0.5) for boxes in found]
    assert len(clear[0]) == len(clear[1]) > 10
    apart = np.abs(np.sort(clear[0].scores) - np.sort(clear[1].scores))
    assert np.median(apart) < 0.01


def test_asked_about_places_early_sends_the_points_there_only() -> None:
    fusion = CLUSTERED["early"]
    scan = street(OTHER, ("front", "left"))
    pillar = np.array([[10.0, -8.0, z] for z in np.arange(0.3, 2.0, 0.05)], dtype=np.float32)
    scan = np.concatenate([scan, transform(invert(OTHER.matrix()), pillar)])
    car = make((15.0, 2.0, 0.9, 4.5, 1.9, 1.5, 0.0)).transformed(invert(EGO.matrix()))
    usual = EncodeOptions(pose=OTHER, reference=EGO)
    about = replace(usual, demand=encode_places(car, 0.5))
    whole, some = fusion.encode(scan, usual), fusion.encode(scan, about)
    there = OTHER.matrix()

    def sent(payload: bytes) -> Points:
        gathering = fusion.begin(street(EGO, ("back", "right")), EGO.matrix())
        gathering.add(Contribution("B", payload, there))
        assert len(gathering.finish()) == 1
        return transform(there, gathering.sent_points()["B"][0])

    assert len(some) < len(whole)
    from_car = np.abs(sent(some)[:, :2] - CAR)
    assert len(from_car) > 300
    assert (from_car <= (2.25 + 0.7, 0.95 + 0.7)).all()
    assert (np.abs(sent(whole)[:, :2] - [10.0, -8.0]) < 0.2).all(axis=1).any()


def test_an_answer_about_places_has_no_outline_where_none_is_needed() -> None:
    fusion, scan = CLUSTERED["early"], street(OTHER, ("front", "left"))
    car = make((15.0, 2.0, 0.9, 4.5, 1.9, 1.5, 0.0)).transformed(invert(EGO.matrix()))
    usual = EncodeOptions(pose=OTHER, reference=EGO)
    about = replace(usual, demand=encode_places(car, 0.5))
    points, outline = take_outline(fusion.encode(scan, about))
    bare, nothing = take_outline(fusion.encode(scan, replace(about, without_outline=True)))
    assert bare == points
    assert len(outline) > 0 == len(nothing)
    whole = fusion.encode(scan, usual)
    assert fusion.encode(scan, replace(usual, without_outline=True)) == whole


def test_places_mean_nothing_without_where_the_ego_is() -> None:
    scan = street(OTHER, ("front",))
    with pytest.raises(PerceptionError, match="without where the ego is"):
        CLUSTERED["early"].encode(scan, EncodeOptions(pose=OTHER, demand=bytes(7)))
    with pytest.raises(PerceptionError, match="6 bytes are no places"):
        CLUSTERED["early"].encode(scan, EncodeOptions(pose=OTHER, reference=EGO, demand=bytes(6)))


def test_a_stray_return_does_not_cost_the_scan() -> None:
    fusion = CLUSTERED["early"]
    cloud = street(EGO, ("back", "right"))
    stray = np.concatenate([cloud, np.array([[1e6, 0, 0]], dtype=np.float32)])
    assert fusion.encode(stray, EncodeOptions()) == fusion.encode(cloud, EncodeOptions())


def test_a_contribution_of_millions_of_points_is_rejected_unread() -> None:
    fusion = CLUSTERED["early"]
    points = encode_points(np.zeros((MAX_POINTS + 1, 3), dtype=np.float32))
    bomb = add_outline(points, np.zeros((0, 2)))
    assert len(bomb) < 20_000
    own = street(EGO, ("back", "right"))
    result = fusion.fuse(own, EGO.matrix(), [Contribution("bad", bomb, OTHER.matrix())])
    assert list(result.rejected) == ["bad"]
    assert len(result.boxes) > 0
