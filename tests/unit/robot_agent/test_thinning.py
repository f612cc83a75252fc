"""A robot within a budget: newest first, small, and never more than it may take."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from robot_agent.pace import HOLD_S, MAX_ECHOES, Pace
from robot_agent.thinning import MAX_SCENE_GAP_S, MIN_SECTORS, RARELY, WIRE_BYTES, Thinner
from swarm.arrays import pack, unpack_finite
from swarm.body import Body
from swarm.messages import Beacon, NetDemand, SceneDescription, encode

BODY = Body(label="robot", size=(1.0, 0.7, 1.2), center=(0.0, 0.0, 0.0))
POSE = (1.25, -2.5, 1.9, 0.0, 0.0, 0.75)
BEACON = Beacon(
    robot="R2",
    instance=2**47,
    seq=1000,
    sent_ns=1_800_000_000_000_000_000,
    capture_ns=1_800_000_000_000_000_000,
    frame=100_000,
    pose=POSE,
    velocity=(0.5, 0.25, 0.0),
    range_m=50.0,
    sizes={"early": 20_000, "intermediate-codebook": 2_000, "late": 300},
    steady_ns=10**14,
)


def scene(objects: int = 30, sectors: int = 72) -> SceneDescription:
    table = np.zeros((objects, 9), np.float32)
    table[:, 7] = np.arange(objects)
    return SceneDescription(
        robot="R2",
        instance=2**47,
        seq=1,
        sent_ns=BEACON.sent_ns,
        capture_ns=BEACON.capture_ns,
        frame=1,
        pose=POSE,
        objects=pack(table),
        visible_m=pack(np.arange(sectors, dtype=np.float32).reshape(-1, 1)),
        ground_points=1,
        elapsed_ms=1.0,
    )


def sent(budget_bps: int | None, seconds: float = 60.0) -> tuple[list[Beacon], int, float]:
    """Beacons of a robot that may speak ten times a second, all its bytes, its longest silence."""
    thinner, beacons, size, last, longest = Thinner(), [], 0, 0.0, 0.0
    for tick in range(round(seconds * 10)):
        now = tick / 10
        if thinner.beacon_is_due(now):
            beacons.append(thinner.beacon(BEACON, budget_bps, now))
            size += len(encode(beacons[-1])) + WIRE_BYTES
            longest, last = max(longest, now - last), now
        if tick % 5 == 0 and thinner.scene_is_due(now):
            size += len(encode(thinner.scene(scene(), budget_bps, now))) + WIRE_BYTES
    return beacons, size, longest


def test_without_a_budget_a_robot_says_all_it_can() -> None:
    beacons, _, _ = sent(None)
    assert len(beacons) == 600
    assert all(beacon == BEACON for beacon in beacons)


@pytest.mark.parametrize("budget_bps", [6_000, 12_000, 40_000])
def test_a_robot_keeps_to_its_budget_and_is_known_to_the_second(budget_bps: int) -> None:
    beacons, size, longest_s = sent(budget_bps)
    assert 8 * size / 60.0 <= 1.1 * budget_bps
    assert longest_s < 1.0
    assert any(beacon.sizes for beacon in beacons)
    assert all(beacon.pose == POSE for beacon in beacons)


def test_what_hardly_changes_is_told_every_two_seconds() -> None:
    thinner, beacons = Thinner(), []
    for tick in range(40):
        sizes = {name: size + 50 * (tick % 2) for name, size in BEACON.sizes.items() if size > 500}
        told = msgspec.structs.replace(BEACON, sizes=sizes, body=BODY)
        beacons.append(thinner.beacon(told, 100_000, tick / 10))
    assert [tick for tick, beacon in enumerate(beacons) if beacon.sizes] == [0, 20]
    assert [tick for tick, beacon in enumerate(beacons) if beacon.body] == [0, 20]
    grown = msgspec.structs.replace(BEACON, sizes={"early": 30_000, "intermediate-codebook": 2_000})
    assert thinner.beacon(grown, 100_000, 4.0).sizes


@pytest.mark.parametrize("budget_bps", [8_000, 16_000])
def test_of_few_beacons_each_fifth_tells_what_hardly_changes(budget_bps: int) -> None:
    thinner, beacons, now = Thinner(), [], 0.0
    told = msgspec.structs.replace(BEACON, body=BODY, world="0123456789abcdef", software="1.0.0")
    while now < 60.0:
        if thinner.beacon_is_due(now):
            beacons.append(thinner.beacon(told, budget_bps, now))
        now += 0.01
    for rare in ("sizes", "body", "world", "software"):
        apart = np.diff([i for i, beacon in enumerate(beacons) if getattr(beacon, rare)])
        assert apart.min() >= RARELY
        assert apart.max() <= RARELY + 2


def test_a_robot_that_may_say_next_to_nothing_still_says_where_it_is() -> None:
    beacons, _, longest_s = sent(2_000)
    assert len(beacons) > 20
    assert longest_s < 4.0


def test_a_scene_keeps_the_objects_with_the_most_points_and_hides_what_is_hidden() -> None:
    thinner = Thinner()
    small = thinner.scene(scene(), 6_000, 0.0)
    kept = unpack_finite(small.objects, "objects", 9)[:, 7]
    visible = unpack_finite(small.visible_m, "visible_m", 1)[:, 0]
    assert 0 < len(kept) < 30
    assert kept.tolist() == list(range(30 - len(kept), 30))
    assert visible.tolist() == [3.0 * i for i in range(MIN_SECTORS)]
    assert thinner.scene_is_due(MAX_SCENE_GAP_S)


def test_a_scene_that_fits_is_left_as_it_is() -> None:
    assert Thinner().scene(scene(3), 100_000, 0.0) == scene(3)


class Steady:
    def __init__(self) -> None:
        self.now_ns = 10**12

    def __call__(self) -> int:
        return self.now_ns


def demand(ego: str, control_bps: int, cycle: int = 1) -> NetDemand:
    return NetDemand(
        ego=ego,
        cycle=cycle,
        sent_ns=1,
        needed_bytes_s=0,
        possible=True,
        reachable=True,
        unreachable_s=0.0,
        quality=1.0,
        q_min=0.7,
        capacity_bps=1,
        steady_ns=500 + cycle,
        control_bps=control_bps,
    )


def test_the_slowest_of_the_fresh_wishes_counts() -> None:
    steady = Steady()
    pace = Pace(steady)
    assert pace.control_bps("R2") is None
    pace.on_demand(demand("A", 8_000))
    pace.on_demand(demand("B", 0))
    pace.on_demand(demand("C", 20_000))
    assert pace.control_bps("R2") == 8_000
    steady.now_ns += round(0.9 * HOLD_S * 1e9)
    pace.on_demand(demand("C", 20_000, 2))
    steady.now_ns += round(0.2 * HOLD_S * 1e9)
    assert pace.control_bps("R2") == 20_000
    steady.now_ns += round(20 * HOLD_S * 1e9)
    assert pace.control_bps("R2") is None


def test_a_robot_whose_own_beacons_queue_speaks_less_than_the_others() -> None:
    pace = Pace(Steady())
    pace.on_demand(msgspec.structs.replace(demand("A", 8_000), fewer_bps={"R2": 2_000}))
    assert pace.control_bps("R1") == 8_000
    assert pace.control_bps("R2") == 2_000


def test_each_robot_echoes_a_word_once() -> None:
    pace = Pace(Steady())
    pace.on_demand(demand("A", 0))
    assert pace.echoes("R1") == {"A": (501, 10**12)}
    assert pace.echoes("R1") == {}
    assert pace.echoes("R2") == {"A": (501, 10**12)}
    pace.on_demand(msgspec.structs.replace(demand("A", 0), steady_ns=900))
    assert pace.echoes("R1") == {"A": (900, 10**12)}


def test_every_one_of_many_egos_is_heeded_and_echoed_in_turn() -> None:
    steady = Steady()
    pace = Pace(steady)
    for number in range(20):
        steady.now_ns += 1
        pace.on_demand(demand(f"E{number}", 50_000 - number))
    assert pace.control_bps("R2") == 50_000 - 19
    echoed = [pace.echoes("R2") for _ in range(3)]
    assert [len(echo) for echo in echoed] == [MAX_ECHOES, MAX_ECHOES, 20 - 2 * MAX_ECHOES]
    assert [ego for echo in echoed for ego in echo] == [f"E{number}" for number in range(20)]
