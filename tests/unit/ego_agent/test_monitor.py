"""Monitor: what is known of the robots, whatever they send and however their clocks go."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ego_agent.knowledge.model import RobotView
from ego_agent.monitor.identity import DUPLICATE_WINDOW_S
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.robot_table import FORGET_S
from ego_agent.monitor.snapshot import Monitor
from swarm.arrays import pack
from swarm.messages import Beacon, LinkState, NetState, Observation, SceneDescription
from swarm.process import Clock

POSE = (1.0, 2.0, 0.5, 0.0, 0.0, 0.0)


class Time(Clock):
    """Both clocks of the ego, set by the test."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 1000.0

    def now_ns(self) -> int:
        return round(self.now_s * 1e9)

    def monotonic(self) -> float:
        return self.now_s


LAG_S = 0.05
"""From a capture to the message that tells of it."""


def beacon(
    robot: str = "R2",
    seq: int = 1,
    instance: int = 7,
    sent_s: float = 1000.0,
    *,
    steady_s: float = 0.0,
    echoes: dict[str, tuple[int, int]] | None = None,
) -> Beacon:
    return Beacon(
        robot=robot,
        instance=instance,
        seq=seq,
        sent_ns=round(sent_s * 1e9),
        capture_ns=round((sent_s - LAG_S) * 1e9),
        frame=seq,
        pose=POSE,
        velocity=(0.0, 0.0, 0.0),
        range_m=50.0,
        sizes={"early": 100 * seq},
        steady_ns=round(steady_s * 1e9),
        echoes=echoes or {},
    )


def scene(
    robot: str = "R2", seq: int = 1, instance: int = 7, sent_s: float = 1000.0
) -> SceneDescription:
    return SceneDescription(
        robot=robot,
        instance=instance,
        seq=seq,
        sent_ns=round(sent_s * 1e9),
        capture_ns=round((sent_s - LAG_S) * 1e9),
        frame=seq,
        pose=POSE,
        objects=pack(np.zeros((0, 9), np.float32)),
        visible_m=pack(np.zeros((72, 1), np.float32)),
        ground_points=0,
        elapsed_ms=1.0,
    )


def answer(capture_s: float, x: float = 5.0, instance: int = 7, frame: int = 99) -> Observation:
    return Observation(
        robot="R2",
        instance=instance,
        request=1,
        algorithm="late",
        capture_ns=round(capture_s * 1e9),
        frame=frame,
        pose=(x, *POSE[1:]),
        payload=b"boxes",
        encode_ms=1.0,
    )


@pytest.fixture
def time() -> Time:
    return Time()


@pytest.fixture
def monitor(time: Time) -> Monitor:
    return Monitor("R1", LinkEstimate(55e6), clock=time, monotonic=time.monotonic)


def view(monitor: Monitor, robot: str = "R2") -> RobotView:
    return monitor.snapshot(1, 0).robots[robot]


def test_an_answer_tells_where_its_robot_is_as_a_beacon_does(monitor: Monitor, time: Time) -> None:
    monitor.note_answer(answer(999.9))
    assert "R2" not in monitor.snapshot(1, 0).robots, "nobody is known by an answer alone"
    monitor.on_beacon(beacon())
    time.now_s += 0.9
    monitor.note_answer(answer(time.now_s - 0.1))
    time.now_s += 0.3
    seen = view(monitor)
    assert seen.beacon_age_s == pytest.approx(0.4, rel=0.01)
    assert seen.unheard_s == pytest.approx(1.2, rel=0.01)
    assert seen.beacon is not None
    assert (seen.beacon.pose[0], seen.beacon.frame, seen.beacon.seq) == (5.0, 99, 1)
    assert seen.beacon.sizes == {"early": 100}
    assert monitor.beacons()[0][0] == seen.beacon
    monitor.on_beacon(beacon(seq=2, sent_s=time.now_s))
    seen = view(monitor)
    assert (seen.beacon_age_s, seen.unheard_s) == (pytest.approx(LAG_S), 0.0)
    assert seen.beacon is not None
    assert seen.beacon.pose == POSE


def test_an_answer_is_no_younger_than_what_it_shows(monitor: Monitor, time: Time) -> None:
    monitor.on_beacon(beacon())
    time.now_s += 2.0
    monitor.note_answer(answer(time.now_s - 1.5))
    assert view(monitor).beacon_age_s == pytest.approx(1.5, rel=0.01)
    monitor.note_answer(answer(time.now_s - 0.2, x=6.0))
    monitor.note_answer(answer(time.now_s - 0.7))
    seen = view(monitor)
    assert seen.beacon_age_s == pytest.approx(0.2, rel=0.01)
    assert seen.beacon is not None
    assert seen.beacon.pose[0] == 6.0


@pytest.mark.parametrize("instance", [7, 8])
def test_an_answer_of_another_process_or_time_does_not_stand_for_the_robot(
    instance: int, monitor: Monitor, time: Time
) -> None:
    monitor.on_beacon(beacon())
    monitor.note_answer(answer(1000.0, instance=instance))
    time.now_s += 1.0
    # A restart, and a time of day that is set back by a minute.
    again = 9 if instance == 8 else 7
    monitor.on_beacon(beacon(seq=2, instance=again, sent_s=941.0))
    seen = view(monitor)
    assert seen.beacon is not None
    assert (seen.beacon.pose, seen.beacon.instance) == (POSE, again)


def test_an_answer_is_no_second_meaning_of_a_beacons_number(monitor: Monitor) -> None:
    monitor.on_beacon(beacon())
    monitor.note_answer(answer(1000.0))
    monitor.on_beacon(beacon())
    assert not view(monitor).duplicate


def test_the_ego_is_one_of_the_robots_and_alive_from_the_start(monitor: Monitor) -> None:
    snapshot = monitor.snapshot(3, 42)
    assert (snapshot.ego, snapshot.cycle, snapshot.now_ns) == ("R1", 3, 42)
    assert snapshot.robots["R1"].alive
    assert (snapshot.capacity_bps, snapshot.capacity_source) == (55e6, "prior")


@pytest.mark.parametrize("offset_s", [-900.0, 0.0, 900.0])
def test_ages_count_from_the_capture_whatever_the_robots_clock_says(
    monitor: Monitor, time: Time, offset_s: float
) -> None:
    monitor.on_beacon(beacon(sent_s=time.now_s + offset_s))
    monitor.on_scene(scene(sent_s=time.now_s + offset_s))
    time.now_s += 1.5
    assert view(monitor).beacon_age_s == pytest.approx(1.5 + LAG_S, abs=1e-3)
    assert view(monitor).scene_age_s == pytest.approx(1.5 + LAG_S, abs=1e-3)


def test_a_robot_that_was_only_seen_alive_has_nothing_yet(monitor: Monitor) -> None:
    monitor.on_join("R2")
    assert view(monitor).alive
    assert view(monitor).beacon is None
    assert view(monitor).beacon_age_s == float("inf")


def test_who_leaves_is_no_longer_alive_but_still_known(monitor: Monitor) -> None:
    monitor.on_join("R2")
    monitor.on_beacon(beacon())
    monitor.on_leave("R2")
    assert not view(monitor).alive
    assert not monitor.is_alive("R2")
    assert view(monitor).beacon is not None


@pytest.mark.parametrize("offset_s", [-30.0, 0.0, 30.0])
def test_the_clock_offset_is_found_but_for_the_shortest_delay(
    monitor: Monitor, time: Time, offset_s: float
) -> None:
    for seq, delay_s in enumerate([0.020, 0.004, 0.300, 0.010], start=1):
        time.now_s += 0.5
        monitor.on_beacon(beacon(seq=seq, sent_s=time.now_s - delay_s + offset_s))
    assert view(monitor).clock_offset_s == pytest.approx(offset_s - 0.004, abs=1e-3)
    assert monitor.clock_offset_ns("R2") == pytest.approx((offset_s - 0.004) * 1e9, abs=1e6)


def test_a_queue_that_builds_up_makes_beacons_old_and_does_not_shift_the_clock(
    monitor: Monitor, time: Time
) -> None:
    for seq in range(1, 901):
        time.now_s += 0.1
        sent_s = time.now_s - 0.005 - min(5.5, 0.06 * max(0, seq - 10))
        monitor.on_beacon(beacon(seq=seq, sent_s=sent_s, steady_s=sent_s))
    held = view(monitor)
    assert abs(held.clock_offset_s) < 0.05
    assert held.delay_s == pytest.approx(5.5, abs=0.05)
    assert held.beacon_age_s == pytest.approx(5.5 + LAG_S, abs=0.05)


def test_an_ego_that_starts_behind_a_queue_learns_of_it_from_its_echoes(
    monitor: Monitor, time: Time
) -> None:
    for seq in range(1, 4):
        stamp = monitor.stamp()
        heard_s = time.now_s + 0.01
        time.now_s += 3.01
        echoes = {"R1": (stamp, round((heard_s - 400.0) * 1e9))}
        monitor.on_beacon(
            beacon(seq=seq, sent_s=heard_s + 7.0, steady_s=heard_s - 400.0, echoes=echoes)
        )
    held = view(monitor)
    assert held.clock_offset_s == pytest.approx(7.0, abs=0.03)
    assert held.beacon_age_s == pytest.approx(3.0 + LAG_S, abs=0.03)


@pytest.mark.parametrize("jump_s", [-3600.0, -0.5, 0.5, 3600.0])
def test_a_time_of_day_that_jumps_is_followed_at_once(
    monitor: Monitor, time: Time, jump_s: float
) -> None:
    for seq, jumped_s in enumerate([0.0] * 5 + [jump_s] * 2, start=1):
        time.now_s += 0.1
        sent_s = time.now_s - 0.005
        monitor.on_beacon(beacon(seq=seq, sent_s=sent_s + jumped_s, steady_s=sent_s - 300.0))
        assert view(monitor).clock_offset_s == pytest.approx(jumped_s, abs=0.01)
        assert view(monitor).beacon_age_s == pytest.approx(LAG_S, abs=0.01)


def test_the_egos_own_time_of_day_may_jump_too(time: Time) -> None:
    jumped = Clock(-7200.0)
    monitor = Monitor("R1", LinkEstimate(55e6), clock=jumped, monotonic=time.monotonic)
    wall_s = jumped.now_ns() * 1e-9 + 7200.0
    time.now_s += 0.1
    monitor.on_beacon(beacon(sent_s=wall_s, steady_s=time.now_s - 0.005))
    assert view(monitor).beacon_age_s == pytest.approx(LAG_S, abs=0.02)
    assert view(monitor).clock_offset_s == pytest.approx(7200.0, abs=0.1)


def test_a_robot_that_tells_only_the_time_of_day_may_set_it_back(
    monitor: Monitor, time: Time
) -> None:
    for seq, jumped_s in enumerate([0.0] * 5 + [-20.0] * 2, start=1):
        time.now_s += 0.1
        monitor.on_beacon(beacon(seq=seq, sent_s=time.now_s - 0.005 + jumped_s))
    assert view(monitor).clock_offset_s == pytest.approx(-20.0, abs=0.01)
    assert view(monitor).beacon_age_s == pytest.approx(LAG_S, abs=0.01)


def test_an_echo_of_something_that_the_ego_never_sent_is_ignored(
    monitor: Monitor, time: Time
) -> None:
    monitor.on_beacon(beacon(sent_s=time.now_s, steady_s=time.now_s, echoes={"R1": (5, 10**15)}))
    assert view(monitor).clock_offset_s == pytest.approx(0.0, abs=0.001)


def test_an_old_message_does_not_replace_a_newer_one(monitor: Monitor) -> None:
    for seq in (1, 3, 2, 3):
        monitor.on_beacon(beacon(seq=seq))
        monitor.on_scene(scene(seq=seq))
    held = view(monitor)
    assert held.beacon is not None
    assert held.scene is not None
    assert (held.beacon.seq, held.scene.seq) == (3, 3)
    assert monitor.counts().out_of_order == 4


def test_a_restarted_robot_is_taken_at_once_with_its_new_count(
    monitor: Monitor, time: Time
) -> None:
    monitor.on_beacon(beacon(seq=900, instance=1))
    time.now_s += 0.1
    monitor.on_beacon(beacon(seq=1, instance=2))
    held = view(monitor)
    assert held.beacon is not None
    assert (held.beacon.instance, held.beacon.seq) == (2, 1)
    assert not held.duplicate


def test_two_processes_heard_in_turn_are_a_duplicate(monitor: Monitor, time: Time) -> None:
    for seq in range(1, 4):
        for instance in (1, 2):
            monitor.on_beacon(beacon(seq=seq, instance=instance))
            time.now_s += 0.05
    assert view(monitor).duplicate


def test_a_duplicate_is_taken_again_when_only_one_is_heard(monitor: Monitor, time: Time) -> None:
    for seq in range(1, 4):
        for instance in (1, 2):
            monitor.on_beacon(beacon(seq=seq, instance=instance))
            time.now_s += 0.05
    for seq in range(4, 5 + round(DUPLICATE_WINDOW_S / 0.1)):
        monitor.on_beacon(beacon(seq=seq, instance=2))
        time.now_s += 0.1
    assert not view(monitor).duplicate


def test_a_scene_counts_as_hearing_a_process_too(monitor: Monitor, time: Time) -> None:
    monitor.on_beacon(beacon(instance=1))
    monitor.on_scene(scene(instance=2))
    assert not view(monitor).duplicate
    monitor.on_beacon(beacon(instance=1, seq=2))
    assert view(monitor).duplicate


def test_what_the_ego_senses_itself_counts_before_what_is_heard_under_its_id(
    monitor: Monitor,
) -> None:
    own = beacon("R1", instance=99)
    monitor.note_own(own, scene("R1", instance=99))
    for seq in range(1, 4):
        for instance in (1, 2):
            monitor.on_beacon(beacon("R1", seq=seq, instance=instance))
    monitor.on_leave("R1")
    held = view(monitor, "R1")
    assert held.alive
    assert not held.duplicate
    assert held.beacon == msgspec.structs.replace(own, sizes={"early": 300})
    assert held.scene is not None
    assert held.scene.instance == 99


def test_a_flood_of_ids_is_bounded_and_leaves_the_known_robots_alone(time: Time) -> None:
    monitor = Monitor("R1", LinkEstimate(55e6), clock=time, monotonic=time.monotonic, max_robots=8)
    monitor.on_join("R2")
    for i in range(100):
        monitor.on_beacon(beacon(f"X{i}"))
        monitor.on_join(f"Y{i}")
    robots = monitor.snapshot(1, 0).robots
    assert len(robots) == 8
    assert {"R1", "R2"} <= set(robots)
    assert monitor.counts().no_room > 0


def test_tokens_and_beacons_alone_keep_no_robot_out(time: Time) -> None:
    monitor = Monitor("R1", LinkEstimate(55e6), clock=time, monotonic=time.monotonic, max_robots=8)
    for i in range(100):
        monitor.on_join(f"Y{i}")
        monitor.on_beacon(beacon(f"X{i}"))
    for robot in ("R2", "R3"):
        monitor.on_join(robot)
        monitor.on_beacon(beacon(robot))
        assert monitor.is_alive(robot)
    # Nor do they take it from those that have both.
    for i in range(100, 200):
        monitor.on_join(f"Y{i}")
        monitor.on_beacon(beacon(f"X{i}"))
    robots = monitor.snapshot(1, 0).robots
    assert len(robots) == 8
    assert {"R1", "R2", "R3"} <= set(robots)


def test_a_token_that_found_no_room_counts_when_the_robot_speaks(time: Time) -> None:
    monitor = Monitor("R1", LinkEstimate(55e6), clock=time, monotonic=time.monotonic, max_robots=2)
    monitor.on_join("R2")
    monitor.on_join("R3")
    assert not monitor.is_alive("R3")
    monitor.on_beacon(beacon("R3"))
    assert monitor.is_alive("R3")
    monitor.on_leave("R3")
    assert not monitor.is_alive("R3")


def test_a_number_far_ahead_silences_nobody_and_is_told(monitor: Monitor, time: Time) -> None:
    for seq in range(1, 4):
        monitor.on_beacon(beacon(seq=seq))
    monitor.on_beacon(beacon(seq=10**12))
    assert view(monitor, "R2").duplicate
    monitor.on_beacon(beacon(seq=4))
    held = view(monitor, "R2")
    assert held.beacon == beacon(seq=4)
    time.now_s += DUPLICATE_WINDOW_S + 0.1
    monitor.on_beacon(beacon(seq=5))
    assert not view(monitor, "R2").duplicate


def test_an_ego_that_has_slept_takes_its_robots_up_again(monitor: Monitor, time: Time) -> None:
    # Its steady clock stood still meanwhile.
    monitor.on_beacon(beacon(seq=1))
    for number in range(40):
        time.now_s += 0.1
        monitor.on_beacon(beacon(seq=36_000 + number))
    held = view(monitor, "R2")
    assert held.beacon is not None
    assert held.beacon.seq == 36_039
    time.now_s += DUPLICATE_WINDOW_S
    monitor.on_beacon(beacon(seq=36_040))
    assert not view(monitor, "R2").duplicate


def test_a_stranger_who_goes_on_far_ahead_takes_nobody_over(monitor: Monitor, time: Time) -> None:
    for number in range(100):
        time.now_s += 0.1
        monitor.on_beacon(beacon(seq=1 + number))
        monitor.on_beacon(beacon(seq=10**12 + number))
    held = view(monitor, "R2").beacon
    assert held == beacon(seq=100)


def test_who_began_with_a_number_far_ahead_does_not_silence_who_counts(monitor: Monitor) -> None:
    monitor.on_beacon(beacon(seq=10**12))
    monitor.on_beacon(beacon(seq=7))
    assert view(monitor, "R2").duplicate
    monitor.on_beacon(beacon(seq=8))
    held = view(monitor, "R2").beacon
    assert held == beacon(seq=8)


def test_one_number_with_two_meanings_is_told(monitor: Monitor) -> None:
    monitor.on_beacon(beacon(seq=1))
    monitor.on_beacon(beacon(seq=1))
    assert not view(monitor, "R2").duplicate
    monitor.on_beacon(msgspec.structs.replace(beacon(seq=1), pose=(9.0, *POSE[1:])))
    assert view(monitor, "R2").duplicate


def test_a_robot_that_was_not_heard_for_long_goes_on(monitor: Monitor, time: Time) -> None:
    monitor.on_beacon(beacon(seq=1))
    time.now_s += 3600.0
    monitor.on_beacon(beacon(seq=36_001, sent_s=4600.0))
    held = view(monitor, "R2")
    assert not held.duplicate
    assert held.beacon is not None
    assert held.beacon.seq == 36_001


def test_robots_that_left_long_ago_make_room(time: Time) -> None:
    monitor = Monitor("R1", LinkEstimate(55e6), clock=time, monotonic=time.monotonic, max_robots=3)
    monitor.on_beacon(beacon("R2"))
    monitor.on_join("R3")
    time.now_s += FORGET_S + 1.0
    monitor.on_beacon(beacon("R4"))
    assert set(monitor.snapshot(1, 0).robots) == {"R1", "R3", "R4"}


def test_a_process_that_changes_its_instance_with_every_message_costs_bounded_memory(
    monitor: Monitor,
) -> None:
    for instance in range(1000):
        monitor.on_beacon(beacon(instance=instance))
    assert view(monitor).beacon is not None
    assert len(monitor._robots.known["R2"].streams) <= 8


def test_the_controllers_word_is_the_capacity(monitor: Monitor) -> None:
    cell = LinkState(
        robot=monitor.ego,
        direction="down",
        capacity_bps=6_000_000,
        available_bps=5_000_000,
        latency_ms=0.0,
        level=0,
        classes={},
    )
    monitor.on_net_state(NetState(controller=1, seq=1, sent_ns=0, links=(cell,)))
    snapshot = monitor.snapshot(1, 0)
    assert (snapshot.capacity_bps, snapshot.capacity_source) == (5e6, "net/state")


def test_round_trips_are_smoothed(monitor: Monitor) -> None:
    monitor.on_join("R2")
    assert view(monitor).round_trip_s is None
    monitor.note_round_trip("R2", 0.1)
    monitor.note_round_trip("R2", 0.2)
    assert view(monitor).round_trip_s == pytest.approx(0.125)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["R1", "R2", "R3"]),
            st.integers(1, 3),
            st.integers(0, 20),
            st.sampled_from(["beacon", "scene", "join", "leave"]),
            st.floats(0, 3),
        ),
        max_size=60,
    )
)
def test_any_sequence_of_events_leaves_a_consistent_snapshot(
    events: list[tuple[str, int, int, str, float]],
) -> None:
    time = Time()
    monitor = Monitor("R1", LinkEstimate(55e6), clock=time, monotonic=time.monotonic)
    for robot, instance, seq, kind, pause_s in events:
        time.now_s += pause_s
        if kind == "beacon":
            monitor.on_beacon(beacon(robot, seq, instance, time.now_s))
        elif kind == "scene":
            monitor.on_scene(scene(robot, seq, instance))
        elif kind == "join":
            monitor.on_join(robot)
        else:
            monitor.on_leave(robot)
        snapshot = monitor.snapshot(1, 0)
        assert snapshot.robots["R1"].alive
        for name, held in snapshot.robots.items():
            assert held.robot == name
            assert held.beacon_age_s >= 0
            assert held.scene_age_s >= 0


def test_it_is_silent_since_any_robot_was_heard_last(monitor: Monitor, time: Time) -> None:
    assert monitor.silent_s() == float("inf")
    monitor.on_beacon(beacon("R2"))
    time.now_s += 3.0
    monitor.on_scene(scene("R3"))
    time.now_s += 1.0
    assert monitor.silent_s() == 1.0
    monitor.note_own(beacon("R1"))
    assert monitor.silent_s() == 1.0
