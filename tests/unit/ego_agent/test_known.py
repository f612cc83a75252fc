"""Where the ego knows robots to be, and whom it doubts."""

from __future__ import annotations

import math

import msgspec
import pytest

from ego_agent.analyze.doubts import doubted
from ego_agent.knowledge.model import RobotView
from ego_agent.knowledge.objective import Objective
from ego_agent.monitor.known import KnownRobots
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from perception.detector import configuration
from swarm.body import Body
from swarm.errors import MessageError
from swarm.messages import Beacon, decode, encode
from tests.support.ego_scenes import objects, snapshot, view
from tests.unit.ego_agent.test_monitor import LAG_S, POSE, Time, beacon

BODY = configuration("factory").usual_body
OWN = Body(label="robot", size=(1.5, 1.0, 2.0), center=(0.5, 0.0, -1.0))


def heard(*beacons: Beacon) -> tuple[KnownRobots, Time]:
    time = Time()
    monitor = Monitor("E", LinkEstimate(55e6), clock=time, monotonic=time.monotonic)
    for one in beacons:
        monitor.on_beacon(one)
    return KnownRobots(monitor, 1.0, BODY), time


def moving(sent: Beacon, speed: float) -> Beacon:
    return msgspec.structs.replace(sent, velocity=(speed, 0.0, 0.0), body=OWN)


def test_a_robot_is_where_its_speed_has_brought_it() -> None:
    known, time = heard(moving(beacon(), 2.0))
    (one,) = known.at(time.now_ns())
    assert one.robot == "R2"
    assert one.here_from_sensor[0, 3] == pytest.approx(POSE[0] + 2.0 * LAG_S)
    assert one.age_s == pytest.approx(LAG_S)
    assert one.velocity == (2.0, 0.0)
    assert one.box().centers[0] == pytest.approx([POSE[0] + 0.1 + 0.5, POSE[1], POSE[2] - 1.0])
    assert one.box().sizes[0].tolist() == [1.5, 1.0, 2.0]


def test_a_beacon_of_a_second_ago_counts_to_the_end_of_its_second() -> None:
    known, time = heard(moving(beacon(), 2.0))
    later_ns = time.now_ns() + round((0.99 - LAG_S) * 1e9)
    (one,) = known.at(later_ns)
    assert one.here_from_sensor[0, 3] == pytest.approx(POSE[0] + 2.0 * 0.99)
    assert known.at(later_ns + 20_000_000) == ()


def test_a_clock_that_is_off_does_not_move_the_robot() -> None:
    known, time = heard(beacon(sent_s=4600.0, steady_s=50.0))
    (one,) = known.at(time.now_ns())
    assert one.age_s == pytest.approx(LAG_S, abs=1e-6)


def test_a_robot_that_announces_no_body_has_the_usual_one() -> None:
    known, time = heard(beacon())
    assert known.at(time.now_ns())[0].body == BODY


def test_a_robot_whose_id_two_processes_use_is_not_known() -> None:
    known, time = heard(beacon(instance=7), beacon(instance=8), beacon(instance=7, seq=2))
    assert known.at(time.now_ns()) == ()


@pytest.mark.parametrize(
    "size", [(100.0, 1.0, 1.0), (math.nan, 1.0, 1.0), (0.0, 1.0, 1.0), (-1.0, 1.0, 1.0)]
)
def test_a_body_that_none_has_is_refused(size: tuple[float, float, float]) -> None:
    wrong = msgspec.structs.replace(beacon(), body=msgspec.structs.replace(OWN, size=size))
    with pytest.raises(MessageError, match=r"Beacon.*body|body.*Beacon|finite"):
        decode(encode(wrong), Beacon)


def there(
    robot: str,
    x: float,
    y: float,
    visible_m: float = 30.0,
    *,
    sees: tuple[float, float] | None = None,
) -> RobotView:
    """A robot that sees `visible_m` far all around, and an object where `sees` says."""
    table = objects((*sees, 20.0)) if sees is not None else objects()
    return view(robot, x, y, sees=table, visible=[visible_m] * 72)


def doubts(*views: RobotView) -> dict[str, str]:
    return doubted(snapshot(*views), Objective(), BODY)


def test_a_robot_that_two_others_look_through_is_doubted() -> None:
    claim = there("R3", 5.0, 0.0)
    found = doubts(there("E", 0.0, 0.0), there("R2", 5.0, 12.5), claim)
    assert found == {"R3": "2 robots see free ground where it says to stand"}


def test_one_witness_is_not_enough() -> None:
    assert doubts(there("E", 0.0, 0.0), there("R3", 5.0, 0.0)) == {}


def test_whoever_sees_it_there_speaks_for_it() -> None:
    views = [there("E", 0.0, 0.0), there("R2", 5.0, 12.5, sees=(5.2, 0.1)), there("R3", 5.0, 0.0)]
    assert doubts(*views) == {}


def test_a_witness_that_does_not_see_so_far_or_so_finely_says_nothing() -> None:
    blocked = [there("E", 0.0, 0.0, 4.6), there("R2", 5.0, 12.5, 4.6), there("R3", 5.0, 0.0)]
    assert doubts(*blocked) == {}
    far = [there("E", 0.0, 0.0, 60.0), there("R2", 25.0, 25.0, 60.0), there("R3", 25.0, 0.0)]
    assert doubts(*far) == {}
    coarse = [
        view("E", 0.0, 0.0, visible=[30.0] * 8),
        view("R2", 5.0, 12.5, visible=[30.0] * 8),
        there("R3", 5.0, 0.0),
    ]
    assert doubts(*coarse) == {}


def test_an_old_view_is_no_witness() -> None:
    old = [
        view(robot, x, y, visible=[30.0] * 72, scene_age_s=1.5)
        for robot, x, y in (("E", 0.0, 0.0), ("R2", 5.0, 12.5))
    ]
    assert doubts(*old, there("R3", 5.0, 0.0)) == {}


def test_two_robots_in_one_place_are_both_doubted_and_the_ego_is_not() -> None:
    found = doubts(there("E", 0, 0), there("R2", 9.0, 0.0), there("R3", 9.1, 0.0))
    assert found["R2"] == "it says to stand where R3 stands"
    assert found["R3"] == "it says to stand where R2 stands"
    assert set(doubts(there("E", 0, 0), there("R2", 0.0, 0.1))) == {"R2"}


def test_a_view_that_is_none_is_no_witness() -> None:
    broken = view("R2", 5.0, 12.5, visible=[math.nan] * 72)
    assert doubts(there("E", 0.0, 0.0), broken, there("R3", 5.0, 0.0)) == {}
