"""Fused objects as ROS 2 messages, decoded by the `rosbags` package."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from options.ros.definitions import DETECTIONS, GRID, HASHES, MARKERS, definition
from options.ros.fused import DRAWN, FRESH_NS, OBJECTS, REACH_M, RESOLUTION_M, UNSEEN, Said, Teller
from swarm.arrays import pack
from swarm.errors import MessageError
from swarm.messages import Detections, SceneDescription
from tests.support.message_samples import NOW, SAMPLES

STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(
    {
        name: fields
        for name, fields in get_types_from_msg(definition(DETECTIONS), DETECTIONS).items()
        if name.startswith("vision_msgs/")
    }
)
DOUBTED = next(one for one in SAMPLES if isinstance(one, Detections))
FOUND = msgspec.structs.replace(
    DOUBTED, known=tuple(msgspec.structs.replace(one, doubt="") for one in DOUBTED.known)
)
SCENE = next(one for one in SAMPLES if isinstance(one, SceneDescription))
SECOND = 1_000_000_000


def decoded(said: Said) -> Any:
    """The message as ROS would read it; written anew it is the same bytes."""
    message = STORE.deserialize_cdr(said.payload, said.topic.kind)
    assert bytes(STORE.serialize_cdr(message, said.topic.kind)) == said.payload
    return message


def scene(robot: str, visible_m: list[float], x: float = 0.0, y: float = 0.0) -> SceneDescription:
    seen = pack(np.array(visible_m, dtype=np.float32).reshape(-1, 1))
    return msgspec.structs.replace(SCENE, robot=robot, pose=(x, y, 1.0, 0, 0, 0), visible_m=seen)


@pytest.mark.parametrize("kind", HASHES)
def test_types_have_the_hashes_that_ros_gives_them(kind: str) -> None:
    ours = get_typestore(Stores.EMPTY)
    ours.register(get_types_from_msg(definition(kind), kind))
    assert ours.hash_rihs01(kind) == HASHES[kind] == STORE.hash_rihs01(kind)


def test_remembered_objects_and_known_robots_are_detections_with_their_ids() -> None:
    objects, _ = Teller("R2").on_detections(FOUND)
    assert objects.topic is OBJECTS
    assert objects.stamp_ns == NOW
    message = decoded(objects)
    assert message.header.frame_id == "map"
    assert message.header.stamp.sec * SECOND + message.header.stamp.nanosec == NOW
    forklift, robot = message.detections
    assert (forklift.id, robot.id) == ("7", "R1")
    (what,) = forklift.results
    assert (what.hypothesis.class_id, what.hypothesis.score) == ("forklift", 0.75)
    center, size = forklift.bbox.center.position, forklift.bbox.size
    assert (center.x, center.y, center.z, size.x, size.y, size.z) == (0, 1, 2, 3, 4, 5)
    turned = forklift.bbox.center.orientation
    assert 2 * math.atan2(turned.z, turned.w) == pytest.approx(6.0)
    assert robot.results[0].hypothesis.class_id == "robot"


def test_a_robot_that_is_doubted_is_no_detection() -> None:
    objects, _ = Teller("R2").on_detections(DOUBTED)
    (forklift,) = decoded(objects).detections
    assert forklift.id == "7"


def test_an_ego_without_memory_tells_what_it_found_in_this_frame() -> None:
    objects, drawn = Teller("R2").on_detections(msgspec.structs.replace(FOUND, tracks=None))
    forklift, _ = decoded(objects).detections
    assert (forklift.id, forklift.results[0].hypothesis.score) == ("", 0.5)
    assert not [one for one in decoded(drawn).markers if one.ns == "velocities"]


def test_markers_take_the_place_of_those_before() -> None:
    _, drawn = Teller("R2").on_detections(FOUND)
    assert drawn.topic is DRAWN
    first, *others = decoded(drawn).markers
    assert first.action == first.DELETEALL
    assert [(one.ns, one.id, one.type) for one in others] == [
        ("objects", 0, first.CUBE),
        ("labels", 0, first.TEXT_VIEW_FACING),
        ("objects", 1, first.CUBE),
        ("labels", 1, first.TEXT_VIEW_FACING),
        ("velocities", 0, first.ARROW),
    ]
    assert {one.action for one in others} == {first.ADD}
    assert others[1].text == "forklift 7 0.75"
    begin, end = others[-1].points
    assert (end.x - begin.x, end.y - begin.y) == (1.5, -0.25)
    # What was seen before, and not now, is fainter than a robot that tells where it is.
    assert others[0].color.a < others[2].color.a


def test_detections_of_nothing_are_told_too() -> None:
    empty = msgspec.structs.replace(
        FOUND,
        known=(),
        tracks=None,
        boxes=pack(np.zeros((0, 7), dtype=np.float32)),
        scores=pack(np.zeros((0, 1), dtype=np.float32)),
        labels=(),
    )
    objects, drawn = Teller("R2").on_detections(empty)
    assert not len(decoded(objects).detections)
    assert len(decoded(drawn).markers) == 1


def test_the_grid_is_known_where_somebody_sees_the_ground() -> None:
    teller = Teller("R1")
    # R2 sees the quadrant to its north-east, 4 m far; R1 nothing.
    assert teller.on_scene(scene("R2", [4.0, 0, 0, 0], x=10.0, y=-5.0), 0) == ()
    (said,) = teller.on_scene(scene("R1", [0.0], x=1.0, y=2.0), SECOND)
    assert said.topic is UNSEEN
    message = decoded(said)
    side = round(2 * REACH_M / RESOLUTION_M)
    assert (message.info.width, message.info.height) == (side, side)
    corner = message.info.origin.position
    assert (corner.x, corner.y) == (1.0 - REACH_M, 2.0 - REACH_M)
    cells = message.data.reshape(side, side)
    assert set(np.unique(cells)) == {-1, 0}

    def at(x: float, y: float) -> int:
        row, column = (y - corner.y) / RESOLUTION_M, (x - corner.x) / RESOLUTION_M
        return int(cells[math.floor(row), math.floor(column)])

    assert at(12.2, -3.2) == 0
    assert [at(x, y) for x, y in ((8.2, -3.2), (12.2, -6.8), (13.2, -1.8), (0.2, 0.2))] == [-1] * 4
    # A quarter of a disc of 4 m, by cells of a quarter of a square metre.
    assert (cells == 0).sum() / 4 == pytest.approx(math.pi * 16 / 4, rel=0.05)


def test_a_robot_that_fell_silent_sees_nothing_any_more() -> None:
    teller = Teller("R1")
    teller.on_scene(scene("R2", [4.0]), 0)
    for came_ns, seen in ((FRESH_NS, True), (FRESH_NS + 1, False)):
        (said,) = teller.on_scene(scene("R1", []), came_ns)
        assert bool((decoded(said).data == 0).any()) is seen


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"tracks": None, "labels": ()}, "1 objects with 0 labels"),
        ({"capture_ns": 2**31 * SECOND}, "ROS 2 can name times before"),
        ({"tracks": None, "boxes": pack(np.zeros((1, 3), dtype=np.float32))}, r"\(N, 7\)"),
    ],
)
def test_what_is_no_detections_is_named(values: dict[str, Any], words: str) -> None:
    with pytest.raises(MessageError, match=words):
        Teller("R2").on_detections(msgspec.structs.replace(FOUND, **values))


def test_definitions_stand_alone() -> None:
    for kind in (GRID, MARKERS, DETECTIONS):
        assert kind in get_types_from_msg(definition(kind), kind)
    with pytest.raises(KeyError):
        definition("std_msgs/msg/String")
