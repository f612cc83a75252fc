"""One pass over points, maps and boxes: alone each is what it was, together they see more."""

from __future__ import annotations

import numpy as np
import pytest

from perception.boxes import iou_bev, weighted_fusion
from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from perception.detector.weight_files import has_weights, weight_file
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.fusion.detectors import shared_detector, shared_finder
from perception.fusion.known import without_own
from perception.fusion.mixed import Mixed
from perception.fusion.one_pass import BoxForm, MapForm
from perception.fusion.registry import fusion_names, make_fusion
from perception.types import Boxes, clean_points
from swarm.errors import PayloadError, PerceptionError
from swarm.geometry import Matrix, Points, invert, pose_of, transform
from worlds.base import Scan
from worlds.cooperative.fusing import fuse_frame
from worlds.cooperative.judging import judge
from worlds.factory.world import FactoryWorld

pytestmark = pytest.mark.skipif(
    not has_weights("factory"), reason=f"no weights {weight_file('factory').name}: make train"
)
FRAME = 120
SENDERS = ("R2", "R3", "R4")


@pytest.fixture(scope="module")
def world() -> FactoryWorld:
    return FactoryWorld(robots=4, seed=1_000_003)


@pytest.fixture(scope="module")
def scans(world: FactoryWorld) -> dict[str, Scan]:
    return {robot: world.scan(robot, FRAME) for robot in world.robots}


@pytest.fixture(scope="module")
def forms() -> dict[str, Fusion]:
    return {name: make_fusion(name, "factory") for name in fusion_names("factory")}


def sent(fusion: Fusion, scans: dict[str, Scan], robot: str, form: str = "") -> Contribution:
    """What a robot sends to R1."""
    scan, ego = scans[robot], scans["R1"]
    ask = fusion.begin(ego.points, ego.pose.matrix()).ask()
    options = EncodeOptions(pose=scan.pose, reference=ask.reference, demand=ask.demand)
    payload = fusion.encode(scan.points, options)
    return Contribution(robot, payload, scan.pose.matrix(), form=form)


def same(a: Boxes, b: Boxes) -> bool:
    fields = ("centers", "sizes", "headings", "scores")
    return a.labels == b.labels and all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in fields
    )


@pytest.mark.parametrize("name", fusion_names("factory"))
def test_one_kind_only_is_that_fusion_to_the_last_digit(
    name: str, scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    own = scans["R1"]
    alone = forms[name].fuse(
        own.points, own.pose.matrix(), [sent(forms[name], scans, robot) for robot in SENDERS]
    )
    mixed = Mixed({name: forms[name]}).fuse(
        own.points, own.pose.matrix(), [sent(forms[name], scans, robot, name) for robot in SENDERS]
    )
    # Other forms that might have come, too, change nothing.
    every = Mixed(forms).fuse(
        own.points, own.pose.matrix(), [sent(forms[name], scans, robot, name) for robot in SENDERS]
    )
    assert len(alone.boxes) > 3
    assert same(alone.boxes, mixed.boxes)
    assert same(alone.boxes, every.boxes)
    assert alone.rejected == mixed.rejected == every.rejected == {}


def test_points_are_found_in_one_cloud(scans: dict[str, Scan], forms: dict[str, Fusion]) -> None:
    own, early = scans["R1"], forms["early"]
    early.corrects = False
    try:
        given = [sent(early, scans, robot) for robot in SENDERS]
        fused = early.fuse(own.points, own.pose.matrix(), given).boxes
    finally:
        del early.corrects
    clouds = [clean_points(own.points)]
    for one in given:
        sender = invert(own.pose.matrix()) @ one.world_from_sensor
        clouds.append(clean_points(transform(sender, decode_points(take_outline(one.payload)[0]))))
    finder = shared_finder("factory")
    found = finder.find(np.concatenate(clouds))
    expected = without_own(found, finder.config.own_body_m).transformed(own.pose.matrix())
    assert same(fused, expected)


def test_maps_are_joined_before_they_are_decoded(
    scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    own, fusion = scans["R1"], forms["intermediate"]
    assert isinstance(fusion, MapForm)
    fusion.corrects = False
    try:
        given = [sent(fusion, scans, robot) for robot in SENDERS]
        fused = fusion.fuse(own.points, own.pose.matrix(), given).boxes
    finally:
        del fusion.corrects
    detector, here = shared_detector("factory"), pose_of(own.pose.matrix())
    maps = [fusion.read(take_outline(one.payload)[0], here) for one in given]
    found = detector.decode(fusion.join(detector.encode(clean_points(own.points)), maps))
    expected = without_own(found, shared_finder("factory").config.own_body_m)
    assert same(fused, expected.transformed(own.pose.matrix()))


def test_boxes_are_merged_with_the_own_ones(
    scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    own, fusion = scans["R1"], forms["late"]
    assert isinstance(fusion, BoxForm)
    fusion.corrects = False
    try:
        given = [sent(fusion, scans, robot) for robot in SENDERS]
        fused = fusion.fuse(own.points, own.pose.matrix(), given).boxes
    finally:
        del fusion.corrects
    finder = shared_finder("factory")
    parts = [finder.find(clean_points(own.points))]
    for one in given:
        sender = invert(own.pose.matrix()) @ one.world_from_sensor
        parts.append(fusion.read(take_outline(one.payload)[0]).transformed(sender))
    merged = weighted_fusion(Boxes.concatenate(parts))
    expected = without_own(merged, finder.config.own_body_m).transformed(own.pose.matrix())
    assert same(fused, expected)


def test_each_robot_in_its_own_form(
    world: FactoryWorld, scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    own = scans["R1"]
    given = [
        sent(forms[name], scans, robot, name)
        for robot, name in zip(SENDERS, ("early", "intermediate-codebook", "late"), strict=True)
    ]
    mixed = Mixed(forms).fuse(own.points, own.pose.matrix(), given)
    assert mixed.rejected == {}

    def certainty(boxes: Boxes) -> float:
        """Sum over the true boxes of the best score of a box that shows them."""
        found, truth = judge(world, FRAME, "R1", boxes, robots=True)
        shows = iou_bev(found, truth) >= 0.5
        return float((shows * found.scores[:, None]).max(axis=0, initial=0.0).sum())

    single = Mixed(forms).fuse(own.points, own.pose.matrix(), [])
    assert certainty(mixed.boxes) > certainty(single.boxes) + 0.2


def test_a_frame_of_several_forms_is_fused_again_by_a_function_call(
    world: FactoryWorld, scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    sends = {"R2": "early", "R3": "late"}
    own = scans["R1"]
    given = [sent(forms[form], scans, robot, form) for robot, form in sends.items()]
    mixed = Mixed({form: forms[form] for form in ("early", "late")})
    expected = mixed.fuse(own.points, own.pose.matrix(), given).boxes
    again = fuse_frame(world, FRAME, "R1", ["R2", "R3"], "mixed", forms=sends)
    assert same(again.found, expected)
    assert set(again.bytes) == {"R2", "R3"}
    assert 0 < len(again.boxes) <= len(expected)


def test_what_cannot_be_read_costs_its_sender_only(
    scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    own = scans["R1"]
    good = sent(forms["early"], scans, "R2", "early")
    other = sent(forms["late"], scans, "R3", "early")
    fused = Mixed(forms).fuse(own.points, own.pose.matrix(), [good, other])
    alone = Mixed(forms).fuse(own.points, own.pose.matrix(), [good])
    assert list(fused.rejected) == ["R3"]
    assert same(fused.boxes, alone.boxes)


def test_robots_are_told_what_their_form_needs(
    scans: dict[str, Scan], forms: dict[str, Fusion]
) -> None:
    own = scans["R1"]
    frame = Mixed(forms).begin(own.points, own.pose.matrix())
    for name, form in forms.items():
        asked = frame.ask_for(name)
        assert asked == form.begin(own.points, own.pose.matrix()).ask()
    assert frame.ask_for("late").size() == 0 < frame.ask_for("early").size()
    assert frame.ask_for("early").size() < frame.ask_for("intermediate-sparse").size()


def test_a_late_contribution_is_fused_in_its_own_time(
    world: FactoryWorld, forms: dict[str, Fusion]
) -> None:
    motion = MotionCompensation("factory")
    for frame in (FRAME - 3, FRAME):
        own = world.scan("R1", frame)
        scan = OwnScan(frame / world.rate_hz, own.points, own.pose.matrix())
        gathering = motion.begin(Mixed(forms), scan)
        assert gathering.ask_for("late").reference is None
        for robot, name, late in (("R2", "early", 0), ("R3", "late", 2)):
            other = world.scan(robot, frame - late)
            told = gathering.ask_for(name)
            options = EncodeOptions(pose=other.pose, reference=told.reference)
            payload = forms[name].encode(other.points, options)
            gathering.add(
                Contribution(robot, payload, other.pose.matrix(), late / world.rate_hz, name)
            )
            if frame == FRAME - 3:
                break
        fused = gathering.finish()
    assert len(fused) > 3


def test_what_cannot_be_mixed_is_named() -> None:
    class Other(Fusion):
        name = "other"

        def encode(self, points: Points, options: EncodeOptions) -> bytes:
            return b""

        def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
            raise AssertionError("it is refused before it begins")

    with pytest.raises(PerceptionError, match="other"):
        Mixed({"other": Other()})
    with pytest.raises(PerceptionError, match="none"):
        Mixed({})
    with pytest.raises(PerceptionError, match="early, late"):
        Mixed({name: make_fusion(name, "factory") for name in ("early", "late")}).encode(
            np.zeros((0, 3), np.float32), EncodeOptions()
        )


def test_a_form_s_own_limits_hold(scans: dict[str, Scan], forms: dict[str, Fusion]) -> None:
    own = scans["R1"]
    frame = Mixed(forms).begin(own.points, own.pose.matrix())
    coded = sent(forms["intermediate-codebook"], scans, "R2", "intermediate")
    with pytest.raises(PayloadError, match="not of the form"):
        frame.add(coded)
