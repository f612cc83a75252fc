"""An ego as a station: which of its objects go into messages, and where they are."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from options.etsi.anchor import Anchor, parse_anchor
from options.etsi.station import FIRST_ROBOT, Station, in_world
from swarm.arrays import pack
from swarm.errors import MessageError, SettingError
from swarm.geometry import Pose
from swarm.messages import Detections
from tests.support.message_samples import NOW, SAMPLES

DOUBTED = next(one for one in SAMPLES if isinstance(one, Detections))
FOUND = msgspec.structs.replace(
    DOUBTED, known=tuple(msgspec.structs.replace(one, doubt="") for one in DOUBTED.known)
)
ANCHOR = Anchor(48.8, 2.4)
EGO = Pose(100.0, 50.0, 1.0, yaw=0.5)


def later(seconds: float, **values: object) -> Detections:
    return msgspec.structs.replace(FOUND, capture_ns=NOW + round(seconds * 1e9), **values)


def test_objects_are_told_when_the_rules_say_so() -> None:
    station = Station(7, ANCHOR)
    first = station.message(FOUND, EGO)
    assert first is not None
    assert [(one.id, one.label) for one in first.objects] == [
        (7, "forklift"),
        (FIRST_ROBOT, "robot"),
    ]
    assert (first.station, first.orientation) == (7, 0.5)
    assert station.message(later(0.1), EGO) is None
    # The robot has turned round elsewhere, 5 m on; the forklift is as it was.
    assert first.objects[1].velocity == (1.25, -0.5)
    moved = msgspec.structs.replace(FOUND.known[0], center=(6.5, -2.25, 0.625))
    second = station.message(later(0.2, known=(moved,)), EGO)
    assert second is not None
    assert [one.id for one in second.objects] == [FIRST_ROBOT]
    # And it brakes, where it stands.
    slow = msgspec.structs.replace(moved, velocity=(0.5, -0.5))
    third = station.message(later(0.3, known=(slow,)), EGO)
    assert third is not None
    assert [(one.id, one.velocity) for one in third.objects] == [(FIRST_ROBOT, (0.5, -0.5))]


def test_a_station_does_not_vouch_for_a_robot_that_is_doubted() -> None:
    message = Station(7, ANCHOR).message(DOUBTED, EGO)
    assert message is not None
    assert [one.label for one in message.objects] == ["forklift"]


def test_who_reads_a_message_finds_objects_where_they_are() -> None:
    message = Station(7, ANCHOR).message(FOUND, EGO)
    assert message is not None
    found = in_world(message, ANCHOR)
    np.testing.assert_allclose(found[7].center[:2], (0.0, 1.0), atol=1e-6)
    np.testing.assert_allclose(found[FIRST_ROBOT].center[:2], (1.5, -2.25), atol=1e-6)
    # From another origin, 100 m farther north.
    latitude, longitude = ANCHOR.degrees(0.0, 100.0)
    other = in_world(message, Anchor(latitude, longitude))
    np.testing.assert_allclose(other[7].center[:2], (0.0, -99.0), atol=5e-3)


def test_an_ego_without_memory_cannot_tell() -> None:
    with pytest.raises(MessageError, match="keeps no memory"):
        Station(7, ANCHOR).message(later(0, tracks=None), EGO)
    assert FOUND.tracks is not None
    tracks = msgspec.structs.replace(
        FOUND.tracks, velocities=pack(np.zeros((0, 2), dtype=np.float32))
    )
    with pytest.raises(MessageError, match="tracks in part only"):
        Station(7, ANCHOR).message(later(0, tracks=tracks), EGO)


def test_a_degree_is_as_long_as_on_the_ellipsoid() -> None:
    # Lengths of a degree at 45 degrees, WGS 84: 111,131.8 m north and 78,846.8 m east.
    anchor = Anchor(45.0, 180.0)
    x, y = anchor.metres(45.001, -179.999)
    assert (x, y) == pytest.approx((78.8468, 111.1318), abs=1e-3)
    assert anchor.metres(*anchor.degrees(12.5, -3.25)) == pytest.approx((12.5, -3.25))


@pytest.mark.parametrize("text", ["", "48.8", "48.8;2.4", "91,0", "0,181", "nan,0", "1,2,3"])
def test_an_origin_that_is_none_is_named(text: str) -> None:
    with pytest.raises(SettingError, match="origin"):
        parse_anchor(text)
