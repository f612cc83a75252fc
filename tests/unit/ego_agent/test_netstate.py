"""net/state: an ego takes the word of the controller that speaks for a link, and no other's."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from ego_agent.knowledge.control_share import control_bps
from ego_agent.monitor.evidence import Sample
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.netstate import MAX_LINKS, MAX_SENDERS, SETTLING_S, STEADY_S, LinkWatch
from ego_agent.monitor.snapshot import Monitor
from swarm.controllers import FRESH_S
from swarm.messages import Backlog, ClassName, Direction, LinkClass, LinkState, NetState, TcpState

PRIOR = 55e6
EGO = "R1"


class Ego:
    """A monitor and its estimate, on a clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.link = LinkEstimate(PRIOR)
        self.monitor = Monitor(EGO, self.link, monotonic=lambda: self.now_s)
        self._seq = 0

    def hear(
        self, *links: LinkState, controller: int = 1, seq: int | None = None, name: str = ""
    ) -> None:
        self._seq += 1
        number = self._seq if seq is None else seq
        state = NetState(controller=controller, seq=number, sent_ns=0, links=links, name=name)
        self.monitor.on_net_state(state)

    @property
    def capacity(self) -> tuple[float, str]:
        shot = self.monitor.snapshot(1, 0)
        return shot.capacity_bps, shot.capacity_source

    def of(self, robot: str) -> float:
        return self.link.robot_limits(self.now_s).get(robot, float("inf"))


@pytest.fixture
def ego() -> Ego:
    return Ego()


def state(
    available_bps: float,
    robot: str = EGO,
    direction: Direction = "down",
    *,
    capacity_bps: float = 20e6,
    level: int = 0,
    grants: dict[str, int] | None = None,
    fusion: Backlog | None = None,
    background_bps: int | None = None,
) -> LinkState:
    classes: dict[ClassName, LinkClass] = {}
    if fusion is not None:
        classes["fusion"] = class_of(fusion)
    if background_bps is not None:
        classes["background"] = replace(class_of(Backlog()), throughput_bps=background_bps)
    return LinkState(
        robot=robot,
        direction=direction,
        capacity_bps=int(capacity_bps),
        available_bps=int(available_bps),
        latency_ms=0.0,
        level=level,
        classes=classes,
        grants=grants or {},
    )


def class_of(backlog: Backlog) -> LinkClass:
    return LinkClass(
        rate_bps=1,
        ceil_bps=1,
        priority=1,
        throughput_bps=0,
        sent_bytes=0,
        backlog_bytes=0,
        drops=0,
        overlimits=0,
        backlog=backlog,
    )


def stood(seconds: float, rate_bps: float) -> Backlog:
    """A queue that has stood ever since it was first seen, so long ago."""
    size = int(seconds * rate_bps / 8)
    ms = round(seconds * 1e3)
    return Backlog(seen_ms=ms, sent_bytes=size, stood_ms=ms, stood_bytes=size)


def test_the_cell_is_the_egos_own_link_downwards(ego: Ego) -> None:
    ego.hear(state(3e6, "R2"), state(4e6, EGO, "up"), state(5e6))
    assert ego.capacity == (5e6, "net/state")


def test_an_ego_reckons_with_its_grant_where_egos_share_the_link(ego: Ego) -> None:
    ego.hear(state(10e6, grants={EGO: 4_000_000, "R9": 6_000_000}))
    assert ego.capacity == (4e6, "net/state")
    ego.hear(state(3e6, grants={EGO: 4_000_000}))
    assert ego.capacity == (3e6, "net/state")
    ego.now_s += STEADY_S + 1.0
    ego.hear(state(10e6, grants={"R9": 6_000_000}))
    assert ego.capacity == (10e6, "net/state")


def test_a_state_that_was_overtaken_is_ignored_and_counted(ego: Ego) -> None:
    ego.hear(state(5e6), seq=7)
    ego.hear(state(9e6, capacity_bps=9e6), seq=6)
    ego.hear(state(9e6, capacity_bps=9e6), seq=7)
    assert ego.capacity == (5e6, "net/state")
    assert ego.monitor.counts().out_of_order == 2


def test_a_restarted_controller_counts_anew(ego: Ego) -> None:
    ego.hear(state(5e6), controller=1, seq=900)
    ego.hear(state(9e6), controller=2, seq=1)
    assert ego.capacity == (9e6, "net/state")


def test_a_cell_that_its_controller_no_longer_mentions_is_unshaped(ego: Ego) -> None:
    ego.hear(state(5e6), controller=1)
    ego.hear(controller=1)
    assert ego.capacity == (PRIOR, "prior")


def test_a_cell_that_another_hosts_controller_does_not_mention_stays_shaped(ego: Ego) -> None:
    ego.hear(state(5e6), controller=1)
    ego.hear(state(8e6, "R4", "up"), controller=2)
    assert ego.capacity == (5e6, "net/state")


def test_the_restarted_controller_speaks_for_the_cell_from_then_on(ego: Ego) -> None:
    ego.hear(state(5e6), controller=1)
    ego.hear(state(6e6), controller=2)
    ego.hear(controller=1)
    assert ego.capacity == (6e6, "net/state")
    ego.hear(controller=2)
    assert ego.capacity == (PRIOR, "prior")


def test_another_hosts_controller_has_no_say_about_a_link_that_has_one(ego: Ego) -> None:
    ego.hear(state(5e6), controller=1, name="hall-1")
    ego.hear(state(9e6), controller=2, name="hall-2")
    assert ego.capacity == (5e6, "net/state")
    ego.hear(controller=2, name="hall-2")
    assert ego.capacity == (5e6, "net/state")
    # The link's own controller is away, or has given it up.
    ego.now_s += FRESH_S + 0.5
    ego.hear(state(9e6), controller=2, name="hall-2")
    assert ego.capacity == (9e6, "net/state")


def test_a_robots_link_upwards_bounds_what_it_can_deliver(ego: Ego) -> None:
    ego.hear(state(20e6), state(1e6, "R2", "up"), state(9e6, "R3", "down"))
    assert ego.of("R2") == 1e6
    assert ego.of("R3") == float("inf")
    ego.hear(state(20e6))
    assert ego.of("R2") == float("inf")


def test_a_robots_link_is_in_the_snapshot(ego: Ego) -> None:
    ego.monitor.on_join("R2")
    ego.monitor.on_join("R3")
    ego.hear(state(1e6, "R2", "up"))
    robots = ego.monitor.snapshot(1, 0).robots
    assert robots["R2"].capacity_bps == 1e6
    assert robots["R3"].capacity_bps == float("inf")


def test_telemetry_that_comes_and_goes_counts_as_there(ego: Ego) -> None:
    for i in range(20):
        ego.hear(state(12e6 if i % 2 else 18e6))
        assert i == 0 or ego.capacity == (12e6, "net/state")
        ego.now_s += 1.0


def test_bandwidth_that_stays_free_is_used_after_a_few_states(ego: Ego) -> None:
    ego.hear(state(12e6))
    for _ in range(4):
        ego.now_s += 1.0
        ego.hear(state(18e6))
    assert ego.capacity == (18e6, "net/state")


@pytest.mark.parametrize(("capacity_bps", "level"), [(50e6, 0), (20e6, 1)])
def test_what_is_configured_anew_counts_at_once(ego: Ego, capacity_bps: float, level: int) -> None:
    ego.hear(state(12e6))
    ego.hear(state(18e6, capacity_bps=capacity_bps, level=level))
    assert ego.capacity == (18e6, "net/state")


ROBOTS = ("R2", "R3", "R4", "R5", "R6")


@pytest.mark.parametrize(
    ("capacity_bps", "available_bps"), [(1e6, 0.46e6), (1e6, 0.7e6), (0.3e6, 0.075e6)]
)
def test_control_traffic_that_is_about_to_become_less_is_not_held_against_a_new_link(
    ego: Ego, capacity_bps: float, available_bps: float
) -> None:
    for robot in ROBOTS:
        ego.monitor.on_join(robot)
    ego.hear(state(54e6, capacity_bps=55e6, background_bps=0))
    ego.now_s += SETTLING_S + 1.0
    narrow = state(available_bps, capacity_bps=capacity_bps, background_bps=0)
    ego.hear(narrow)
    assert ego.capacity[0] == pytest.approx(capacity_bps - control_bps(capacity_bps, 6), abs=1.0)
    ego.now_s += SETTLING_S + STEADY_S + 0.1
    ego.hear(narrow)
    assert ego.capacity[0] == available_bps, "it has not become less"


def test_each_of_several_egos_has_its_part_of_what_becomes_free(ego: Ego) -> None:
    for robot in ROBOTS:
        ego.monitor.on_join(robot)
    grants = {EGO: 115_000, "R2": 345_000}
    ego.hear(state(0.46e6, capacity_bps=1e6, background_bps=0, grants=grants))
    assert ego.capacity[0] == pytest.approx((1e6 - control_bps(1e6, 6)) / 4, abs=1.0)


@pytest.mark.parametrize("background_bps", [0, 200_000])
def test_what_becomes_free_is_not_known_beside_telemetry_or_without_robots(
    ego: Ego, background_bps: int
) -> None:
    for robot in ROBOTS if background_bps else ():
        ego.monitor.on_join(robot)
    ego.hear(state(54e6, capacity_bps=55e6, background_bps=background_bps))
    ego.hear(state(0.46e6, capacity_bps=1e6, background_bps=background_bps))
    assert ego.capacity[0] == 0.46e6


def test_another_level_makes_no_new_link(ego: Ego) -> None:
    for robot in ROBOTS:
        ego.monitor.on_join(robot)
    ego.hear(state(0.8e6, capacity_bps=1e6, background_bps=0))
    ego.now_s += SETTLING_S + STEADY_S + 0.1
    ego.hear(state(0.46e6, capacity_bps=1e6, level=1, background_bps=0))
    assert ego.capacity[0] == 0.46e6


def test_a_flood_of_controllers_and_links_costs_bounded_memory(ego: Ego) -> None:
    for controller in range(3 * MAX_SENDERS):
        links = (state(1e6, f"X{controller}-{i}", "up") for i in range(40))
        ego.hear(*links, controller=controller)
    watch = ego.monitor._watch
    assert len(watch._seqs) <= MAX_SENDERS
    assert len(watch._words) <= MAX_LINKS
    ego.hear(state(5e6))
    assert ego.capacity == (5e6, "net/state")


def test_a_shapers_queue_that_stood_explains_what_sockets_show(ego: Ego) -> None:
    for i in range(5):
        links: list[tuple[str, Direction]] = [(EGO, "down"), ("R2", "up"), ("R3", "up")]
        ego.hear(
            *(
                state(5e6, robot, way, fusion=stood(0 if robot == "R3" else i, 5e6))
                for robot, way in links
            )
        )
        slow = Sample(1e6, filled=True, span_s=0.5)
        ego.link.add_cell(slow, ego.now_s)
        ego.link.add_robot("R2", slow, ego.now_s)
        ego.link.add_robot("R3", slow, ego.now_s)
        ego.now_s += 1.0
    ego.now_s -= 1.0
    assert ego.capacity == (5e6, "net/state")
    assert ego.of("R2") == float("inf")
    assert ego.of("R3") == pytest.approx(1e6)


def test_a_shapers_counter_that_began_anew_explains_nothing(ego: Ego) -> None:
    for seconds in (900.0, 0.5):
        ego.hear(state(5e6, fusion=stood(seconds, 5e6)))
        ego.link.add_cell(Sample(1e6, filled=True, span_s=0.1), ego.now_s + 0.5)
        ego.now_s += 1.0
    assert ego.capacity == (pytest.approx(1e6, rel=0.2), "measured")


class Router:
    """Tells an ego's watch of its sockets."""

    def __init__(self, *own: str) -> None:
        self.link = LinkEstimate(PRIOR)
        self.own = set(own)
        self.looked = 0
        self.watch = LinkWatch(EGO, self.link, self._look)
        self._seq = 0

    def _look(self) -> set[str]:
        self.looked += 1
        return self.own

    def tell(self, now_s: float, router: int = 3, **peers: Backlog) -> bool:
        self._seq += 1
        named = {f"10.77.1.{name[1:]}:4000": backlog for name, backlog in peers.items()}
        told = TcpState(router=router, seq=self._seq, sent_ns=0, peers=named)
        return self.watch.take_tcp(told, now_s)

    def stand(self, rate_bps: float, begun_s: float = 0.0, **other: float) -> float:
        """The socket towards the ego stands for three seconds; returns when that is over."""
        for i in range(7):
            peers: dict[str, Any] = {name: stood(i / 2, bps) for name, bps in other.items()}
            assert self.tell(begun_s + i / 2, h1=stood(i / 2, rate_bps), **peers)
        return begun_s + 3.0


def test_an_ego_takes_a_routers_word_on_its_own_connection_only() -> None:
    router = Router("10.77.1.1:4000")
    now = router.stand(2e6, h2=0.1e6, h3=40e6)
    assert router.link.capacity(now) == (pytest.approx(2e6), "measured")


def test_an_ego_that_finds_none_of_its_connections_believes_nothing() -> None:
    router = Router("127.0.0.1:9")
    now = router.stand(2e6)
    assert router.link.capacity(now) == (PRIOR, "prior")


def test_a_connection_that_was_replaced_is_found_and_its_counters_begin_anew() -> None:
    router = Router("10.77.1.1:4000")
    now = router.stand(2e6)
    looked = router.looked
    router.own = {"10.77.1.9:4000"}
    assert router.tell(now + 0.5, h9=stood(0.5, 1e6))
    assert router.looked > looked
    assert router.link.capacity(now)[0] == pytest.approx(2e6)
    router.tell(now + 1.0, h9=stood(1.0, 1e6))
    router.tell(now + 1.5, h9=stood(1.5, 1e6))
    assert router.link.capacity(now + 1.5)[0] == pytest.approx(1e6)


def test_a_restarted_router_is_another_one() -> None:
    router = Router("10.77.1.1:4000")
    now = router.stand(2e6)
    router._seq = 0
    assert router.tell(now + 0.5, router=4, h1=stood(900.0, 0.2e6))
    assert router.link.capacity(now)[0] == pytest.approx(2e6)


def test_a_routers_word_that_was_overtaken_is_ignored() -> None:
    router = Router("10.77.1.1:4000")
    router.stand(2e6)
    router._seq -= 2
    assert not router.tell(9.0, h1=stood(9.0, 1e6))
