"""Fused objects on a router of ROS: over real Zenoh, read by what reads robots' topics."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from options.ros.definitions import DETECTIONS, GRID, HASHES, MARKERS, NO_HASH, definition
from options.ros2.address import Address
from options.ros2.link import Link
from options.ros2.output import Target
from options.ros2.telling import Told, tell
from options.ros2.topic_buffer import Arrived, TopicBuffer
from swarm import keyspace
from swarm.arrays import pack
from swarm.log import make_logger
from swarm.messages import Detections, SceneDescription
from swarm.session import Session
from swarm.traffic import TrafficClass
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import RouterProcess, until

_numbers = itertools.count(200)
DOUBTED = next(one for one in SAMPLES if isinstance(one, Detections))
FOUND = msgspec.structs.replace(
    DOUBTED, known=tuple(msgspec.structs.replace(one, doubt="") for one in DOUBTED.known)
)
SCENE = next(one for one in SAMPLES if isinstance(one, SceneDescription))


def typed(kind: str) -> Any:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition(kind), kind))
    return store


@contextmanager
def telling(router: RouterProcess, swarm: str, target: Target) -> Iterator[list[Told]]:
    """The process's work, on a thread; at its end the list has what came of it."""
    stop = threading.Event()
    out: list[Told] = []
    thread = threading.Thread(
        target=lambda: out.append(tell(router.address, swarm, "R2", target, stop, str)),
        daemon=True,
    )
    thread.start()
    try:
        yield out
    finally:
        stop.set()
        thread.join(20)


@contextmanager
def reader(target: Target) -> Iterator[tuple[Link, dict[str, TopicBuffer]]]:
    """Reads the three topics as a world reads a robot's."""
    names = {"objects": DETECTIONS, "markers": MARKERS, "unseen": GRID}
    buffers = {
        name: TopicBuffer(f"{target.prefix}/{name}", kind, 4) for name, kind in names.items()
    }
    address = Address(
        host=target.host,
        port=target.port,
        domain=target.domain,
        points="/none",
        odom="/none",
        tf_static=buffers["unseen"].topic,
    )
    link = Link(address, list(buffers.values()), "reader", make_logger("test", level="error"))
    try:
        yield link, buffers
    finally:
        link.close()


def first(buffer: TopicBuffer) -> Arrived:
    until(lambda: bool(buffer.recent()), f"something comes on {buffer.topic}")
    return buffer.recent()[-1]


@pytest.mark.parametrize("hashes", [True, False])
def test_what_an_ego_found_comes_on_three_topics_of_ros(
    shared_router: RouterProcess, hashes: bool
) -> None:
    number = next(_numbers)
    swarm = f"ros{number}"
    target = Target(
        host="127.0.0.1",
        port=shared_router.port,
        domain=number - 100,
        prefix=f"/floor{number}",
        hashes=hashes,
    )
    said = threading.Event()
    with (
        Session(shared_router.address, swarm) as ego,
        reader(target) as (link, buffers),
        telling(shared_router, swarm, target) as ended,
    ):

        def speak() -> None:
            """As the ego does, again and again: who listens later hears the next one."""
            while not said.wait(0.05):
                ego.put(keyspace.detections(swarm, "R2"), FOUND, TrafficClass.CONTROL)
                seen = pack(np.array([[5.0]], dtype=np.float32))
                scene = msgspec.structs.replace(SCENE, robot="R2", visible_m=seen)
                ego.put(keyspace.scene(swarm, "R2"), scene, TrafficClass.CONTROL)

        speaker = threading.Thread(target=speak, daemon=True)
        speaker.start()
        try:
            came = {name: first(buffer) for name, buffer in buffers.items()}
            # A map's last message comes to who subscribes after it was said.
            with reader(target) as (_, later):
                first(later["unseen"])
        finally:
            said.set()
            speaker.join()
        until(lambda: len(link.publishers()) == 3, "all publishers are announced")
        shown = {one.topic: (one.kind, one.type_hash) for one in link.publishers()}
    assert shown == {
        one.topic: (one.kind, HASHES[one.kind] if hashes else NO_HASH) for one in buffers.values()
    }
    assert all(one.attachment is not None for one in came.values())
    publishers = {one.attachment.publisher for one in came.values() if one.attachment}
    assert len(publishers) == 3
    objects = typed(DETECTIONS).deserialize_cdr(came["objects"].payload, DETECTIONS)
    assert [one.id for one in objects.detections] == ["7", "R1"]
    drawn = typed(MARKERS).deserialize_cdr(came["markers"].payload, MARKERS)
    assert len(drawn.markers) == 6
    cells = typed(GRID).deserialize_cdr(came["unseen"].payload, GRID).data
    assert set(np.unique(cells)) == {-1, 0}
    (told,) = ended
    assert told.ended == "stopped"
    assert told.messages >= 3
    assert not told.lost


def test_a_router_of_ros_that_is_not_there_is_waited_for_until_somebody_ends_it(
    shared_router: RouterProcess,
) -> None:
    target = Target(host="127.0.0.1", port=1, domain=0)
    with telling(shared_router, "nobody", target) as ended:
        pass
    (told,) = ended
    assert told.ended == "no router of ROS was reached at tcp/127.0.0.1:1"
    assert not told.messages
