"""What a larger site costs an ego that listens to its surroundings: bytes, as the kernel counts."""

from __future__ import annotations

import threading
from contextlib import closing

import zenoh

from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.monitor.surroundings import Surroundings
from research.benchmarks.scale import received_bytes
from research.benchmarks.scale_site import EGO, IN_RANGE, RANGE_M, SWARM, Replayed
from swarm.log import make_logger
from swarm.messages import Beacon, SceneDescription, encode
from swarm.session import Session
from swarm.traffic import TrafficClass
from tests.support.zenoh_fixtures import WAIT_S, RouterProcess, until

ROUNDS = 20
HALF_M = 70.0


class Listening(Monitor):
    """A monitor that says which beacon of the nearest robot has come."""

    def __init__(self, areas: bool) -> None:
        around = Surroundings(RANGE_M, HALF_M, make_logger("test")) if areas else None
        super().__init__(EGO, LinkEstimate(55e6), surroundings=around)
        self.came = threading.Condition()
        self.nearest = -1

    def on_beacon(self, beacon: Beacon) -> None:
        super().on_beacon(beacon)
        if beacon.robot == "R2":
            with self.came:
                self.nearest = beacon.seq
                self.came.notify()

    def await_after(self, seq: int) -> None:
        with self.came:
            assert self.came.wait_for(lambda: self.nearest > seq, WAIT_S)

    def heard(self) -> set[str]:
        return set(self.snapshot(1, 0).robots)


def bytes_of(router: str, robots: int, *, areas: bool) -> int:
    """What ROUNDS beacons and the scenes between them bring to the ego at the site's middle."""
    own = Replayed(0, areas)
    # The far ones first: what the nearest says comes after all of them.
    others = [Replayed(number, areas) for number in reversed(range(1, robots))]
    near = {f"R{number + 1}" for number in range(IN_RANGE + 1)}
    ego = Listening(areas)
    with (
        Session(router, SWARM, timeout_s=10.0) as speaking,
        Session(router, SWARM, timeout_s=10.0) as listening,
        closing(ego),
    ):
        ego.note_own(*own.own())
        ego.attach(listening)

        def put(key: str, message: Beacon | SceneDescription) -> None:
            # As robots do, but nothing is dropped: what is counted does not depend on the machine.
            speaking._connection.zenoh.put(
                key,
                encode(message),
                priority=TrafficClass.CONTROL.priority,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

        def tell() -> None:
            for robot in others:
                robot.tell(put)

        def all_near() -> bool:
            tell()
            return near <= ego.heard()

        until(all_near, "all robots in range are heard")
        before = received_bytes()
        for _ in range(ROUNDS):
            last = ego.nearest
            tell()
            ego.await_after(last)
        return received_bytes() - before


def test_four_times_as_many_robots_cost_an_ego_hardly_more(own_router: RouterProcess) -> None:
    few, many = (bytes_of(own_router.address, n, areas=True) for n in (100, 400))
    assert few > ROUNDS * IN_RANGE * 300
    assert many <= 1.5 * few


def test_without_areas_every_robot_costs_it_as_much(own_router: RouterProcess) -> None:
    few, many = (bytes_of(own_router.address, n, areas=False) for n in (50, 200))
    assert many > 2.5 * few
