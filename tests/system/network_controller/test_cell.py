"""The controller on a shared cell, with the real `tc` and real traffic."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from prometheus_client import CollectorRegistry

from network_controller.controller import Controller
from network_controller.drivers.ifbs import ifb_of
from network_controller.metrics import ControllerMetrics
from network_controller.model import Link
from network_controller.slow_loop import SlowLoop
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wish, Wishes
from swarm.log import make_logger
from swarm.messages import LinkState, NetDemand, ShapeRequest
from swarm.traffic import TrafficClass
from tests.support.deploy_support import await_
from tests.support.link_floods import FLOOD_S, down, floods, ifbs, must_carry
from tests.support.link_support import Links, links

NEAR_BPS, FAR_BPS = 12_000_000, 3_000_000
FUSION = TrafficClass.FUSION


@pytest.fixture(scope="module")
def net() -> Iterator[Links]:
    with links(2) as made:
        yield made


class Site:
    """A controller of both robots' links."""

    def __init__(self, net: Links, *, shared: bool = True, link_bps: int = 0) -> None:
        """`link_bps` is wanted for all links from the start; 0: nothing is."""
        self.net = net
        self.states: dict[Link, LinkState] = {}
        wishes = Wishes(None, 0)
        for robot in net.robots if link_bps else ():
            wishes.put(
                Wish(
                    robot=robot,
                    direction="down",
                    layer="start",
                    kind="rate",
                    operator="up",
                    since_ns=0,
                    rates_bps=(link_bps,),
                )
            )
        self.controller = Controller(
            net.again(),
            wishes,
            SlowLoop(),
            Flows(net.driver),
            ControllerMetrics(CollectorRegistry()),
            None,
            make_logger("test", level="critical"),
            ego=net.robots[0],
            others=net.robots[1:],
            cell=net.robots if shared else (),
        )

    def shape(self, rate_bps: int, robot: str = "") -> None:
        self.controller.request(ShapeRequest(profile="rate", rate_bps=rate_bps, robot=robot))

    def hear(self, states: tuple[LinkState, ...]) -> None:
        self.states = {Link(state.robot, state.direction): state for state in states}

    def told(self, i: int, wanted: Callable[[LinkState], bool]) -> None:
        """Waits until the state of a robot's link is as wanted."""
        link = down(self.net, i)
        await_(
            lambda: link in self.states and wanted(self.states[link]), f"{link} is as it should be"
        )


@contextmanager
def running(site: Site) -> Iterator[Site]:
    """The controller at work; it is stopped as by an operator."""
    stop = threading.Event()
    net = site.net
    site.controller.start()

    def control() -> None:
        site.controller.run(stop, site.hear)

    # A thread is in the network namespace of the one that starts it.
    worker = threading.Thread(target=control)
    worker.start()
    try:
        yield site
    finally:
        stop.set()
        site.controller.wake()
        worker.join()
        site.controller.close()
    assert ifbs() == []
    assert not net.driver.shaped()


def carries(site: Site, bps: int) -> None:
    """Waits until the tree lends out of so much."""
    link = down(site.net, 0)
    await_(
        lambda: site.net.driver.read([link])[link].cell_bps == pytest.approx(bps, rel=0.01),
        f"the cell carries {bps} bit/s",
    )


def test_a_far_station_has_its_time_and_costs_nothing_while_it_is_silent(net: Links) -> None:
    with running(Site(net)) as site:
        site.shape(NEAR_BPS)
        site.shape(FAR_BPS, net.robots[1])
        with floods(net, {0: FUSION}, 3 * FLOOD_S):
            carries(site, NEAR_BPS)
            must_carry(net, {0: NEAR_BPS})
            with floods(net, {1: FUSION}, 2 * FLOOD_S):
                carries(site, (NEAR_BPS + FAR_BPS) // 2)
                must_carry(net, {0: NEAR_BPS // 2, 1: FAR_BPS // 2})
            carries(site, NEAR_BPS)


def test_a_state_tells_the_guarantee_and_what_may_be_borrowed(net: Links) -> None:
    near, far = net.robots
    with running(Site(net)) as site:
        site.shape(NEAR_BPS)
        site.shape(FAR_BPS, far)
        site.told(1, lambda state: state.capacity_bps == FAR_BPS // 2)
        site.controller.on_demand(demand(near, 9_000_000))
        site.controller.on_demand(demand(far, 300_000))
        # A tenth of the far one's time, three quarters of the near one's, and half of the rest.
        site.told(0, lambda state: state.capacity_bps == pytest.approx(0.825 * NEAR_BPS, rel=0.01))
        state = site.states[down(net, 0)]
        assert state.grants == {
            near: pytest.approx(0.825 * NEAR_BPS, rel=0.01),
            far: pytest.approx(0.175 * FAR_BPS, rel=0.01),
        }
        assert state.classes["fusion"].ceil_bps == NEAR_BPS
        assert state.available_bps <= state.capacity_bps


def test_what_a_killed_controller_shared_becomes_links_of_their_own(net: Links) -> None:
    killed = Site(net, link_bps=NEAR_BPS)
    killed.controller.start()
    assert ifbs() == [ifb_of(net.bridge)]
    with running(Site(net, shared=False, link_bps=NEAR_BPS)) as site:
        for i in range(2):
            site.told(i, lambda state: state.capacity_bps == NEAR_BPS and not state.grants)
        assert ifbs() == []


def test_what_a_killed_controller_shared_is_taken_over_or_cleared(net: Links) -> None:
    killed = Site(net, link_bps=NEAR_BPS)
    killed.controller.start()
    link = down(net, 1)
    before = net.driver.read([link])[link].queue
    with running(Site(net, link_bps=NEAR_BPS)) as site:
        site.told(1, lambda state: state.capacity_bps == NEAR_BPS // 2)
        assert net.driver.read([link])[link].queue == before
    again = Site(net, link_bps=NEAR_BPS)
    again.controller.start()
    with running(Site(net)):
        assert ifbs() == []


def demand(ego: str, bps: int) -> NetDemand:
    return NetDemand(
        ego=ego,
        cycle=1,
        sent_ns=0,
        needed_bytes_s=bps // 8,
        possible=True,
        reachable=True,
        unreachable_s=0.0,
        quality=0.9,
        q_min=0.7,
        capacity_bps=1_000_000,
    )
