"""Links that share a medium: one tree of the real `tc`, and real traffic between namespaces."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pytest

from network_controller import ladder, sweep
from network_controller.drivers.ifbs import ifb_of, make_ifb
from network_controller.drivers.netlink import ClassReader
from network_controller.model import ClassShape, Link, LinkShape
from swarm.errors import NetworkError
from swarm.traffic import TrafficClass
from tests.support.link_floods import FLOOD_S, down, floods, ifbs, must_carry
from tests.support.link_support import Links, add_link, fill, must, receive_in, send

CELL_BPS = 10_000_000


def share(
    net: Links, rates_bps: Mapping[int, int], cell_bps: int = CELL_BPS, level: int = 0
) -> None:
    """Shapes links of a cell: each robot's guarantee, by its number; all may have the cell."""
    for i, rate_bps in rates_bps.items():
        shape = ladder.shape(rate_bps, level, ceil_bps=cell_bps, cell_bps=cell_bps)
        net.driver.apply(down(net, i), shape)


def state(device: str) -> str:
    """All that `tc` shows of a device, without the kernel's own handles."""
    ways = (["qdisc"], ["class"], ["filter"], ["filter", "egress"], ["filter", "ingress"])
    shown = "".join(must("tc", what, "show", "dev", device, *more) for what, *more in ways)
    return re.sub(r"\b[0-9a-f]{4}:(?= )", "own:", shown)


def test_one_ego_has_what_the_others_leave_unused(net: Links) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000})
    with floods(net, {0: TrafficClass.FUSION}):
        must_carry(net, {0: CELL_BPS})


@pytest.mark.parametrize("parts", [(5_000_000, 5_000_000), (7_000_000, 3_000_000)])
def test_two_that_want_more_than_there_is_have_what_was_granted(
    net: Links, parts: tuple[int, int]
) -> None:
    share(net, dict(enumerate(parts)))
    with floods(net, dict.fromkeys(range(2), TrafficClass.FUSION)):
        must_carry(net, dict(enumerate(parts)))


def test_background_of_one_takes_nothing_of_anothers_guarantee(net: Links) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000}, level=1)
    with floods(net, {0: TrafficClass.BACKGROUND, 1: TrafficClass.FUSION}):
        must_carry(net, {0: 5_000_000, 1: 5_000_000})


def test_airtime_is_divided_where_a_station_is_far(net: Links) -> None:
    """The near one could have 16 Mbit/s, the far one 4: half of the time each."""
    near = ladder.shape(8_000_000, 0, ceil_bps=16_000_000, cell_bps=10_000_000)
    far = ladder.shape(2_000_000, 0, ceil_bps=4_000_000, cell_bps=10_000_000)
    net.driver.apply(down(net, 0), near)
    net.driver.apply(down(net, 1), far)
    with floods(net, dict.fromkeys(range(2), TrafficClass.FUSION)):
        must_carry(net, {0: 8_000_000, 1: 2_000_000})
    # Alone it has no more than its own rate, whatever the others leave.
    with floods(net, {1: TrafficClass.FUSION}):
        must_carry(net, {1: 4_000_000})


@pytest.mark.parametrize("traffic", TrafficClass)
def test_traffic_goes_through_the_class_of_its_mark_and_address(
    net: Links, traffic: TrafficClass
) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000})
    both = [down(net, 0), down(net, 1)]
    send(net, net.robots[1], 200_000, traffic.tos)
    readings = net.driver.read(both)
    counts = {
        (link, one): reading.classes[one].sent_bytes
        for link, reading in readings.items()
        for one in reading.classes
    }
    assert counts.pop((both[1], traffic)) > 200_000
    assert all(sent < 200_000 for sent in counts.values())


def test_unmarked_traffic_is_background_and_robots_reach_egos(net: Links) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000})
    net.driver.apply(Link(net.robots[1], "up"), ladder.shape(50_000_000, 0))
    receive_in(net.robots[0], "10.77.1.1", 100_000, 0, frm=net.robots[1])
    links = [down(net, 0), Link(net.robots[1], "up")]
    for reading in net.driver.read(links).values():
        assert reading.classes[TrafficClass.BACKGROUND].sent_bytes > 100_000


def test_what_waits_is_read_from_the_links_own_classes(net: Links) -> None:
    share(net, {0: 10_000, 1: 10_000}, cell_bps=20_000)
    fill("10.77.1.2", 40_000, TrafficClass.FUSION.tos)
    readings = net.driver.read([down(net, 0), down(net, 1)])
    reader = ClassReader()
    for link, reading in readings.items():
        seen = reader.read(reading.queue)
        assert set(seen) == set(TrafficClass)
        for traffic, queue in seen.items():
            shown = reading.classes[traffic].backlog_bytes
            assert queue.waiting_bytes == pytest.approx(shown, abs=4096)
        waiting = seen[TrafficClass.FUSION].waiting_bytes
        assert waiting > 20_000 if link == down(net, 1) else waiting == 0
    reader.close()


def test_a_change_keeps_what_queues_hold_and_the_others_as_they_are(net: Links) -> None:
    share(net, {0: 10_000, 1: 10_000}, cell_bps=20_000)
    fill("10.77.1.1", 40_000, TrafficClass.FUSION.tos)
    before = net.driver.read([down(net, 0), down(net, 1)])
    share(net, {0: 14_000}, cell_bps=20_000)
    after = net.driver.read([down(net, 0), down(net, 1)])
    fusion = after[down(net, 0)].classes[TrafficClass.FUSION]
    assert fusion.drops == before[down(net, 0)].classes[TrafficClass.FUSION].drops
    assert fusion.backlog_bytes > 20_000
    assert after[down(net, 0)].capacity_bps == 14_000
    assert after[down(net, 1)].capacity_bps == before[down(net, 1)].capacity_bps


def test_a_new_driver_finds_the_tree_and_goes_on_from_there(net: Links) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000}, level=2)
    later = net.again()
    both = {down(net, 0), down(net, 1)}
    assert later.shaped() == both
    for reading in later.read(both).values():
        shapes = {traffic: one.shape for traffic, one in reading.classes.items()}
        assert ladder.level_of(reading.capacity_bps, shapes) == 2
        assert reading.cell_bps == CELL_BPS
    before = {link: reading.queue for link, reading in later.read(both).items()}
    share(net, {1: 4_000_000})
    assert {link: reading.queue for link, reading in later.read(both).items()} == before


def test_clearing_is_complete_and_leaves_the_others(net: Links) -> None:
    before = [state(net.device(robot)) for robot in net.robots]
    share(net, {0: 5_000_000, 1: 5_000_000})
    net.driver.apply(Link(net.robots[0], "up"), ladder.shape(CELL_BPS, 0))
    for _ in range(2):
        net.driver.clear(down(net, 0))
    assert net.driver.shaped() == {down(net, 1), Link(net.robots[0], "up")}
    send(net, net.robots[0], 100_000, TrafficClass.FUSION.tos)
    net.driver.clear(Link(net.robots[0], "up"))
    assert ifbs() == [ifb_of(net.bridge)]
    net.driver.clear(down(net, 1))
    assert ifbs() == []
    assert [state(net.device(robot)) for robot in net.robots] == before


def test_a_link_leaves_for_one_of_its_own_and_comes_back(net: Links) -> None:
    device = net.device(net.robots[0])
    net.driver.apply(down(net, 0), ladder.shape(CELL_BPS, 0))
    alone = state(device)
    share(net, {0: 5_000_000, 1: 5_000_000})
    assert "htb" not in state(device)
    assert net.driver.read([down(net, 0)])[down(net, 0)].cell_bps == CELL_BPS
    for i in range(2):
        net.driver.apply(down(net, i), ladder.shape(CELL_BPS, 0))
    assert ifbs() == []
    assert sorted(state(device).split()) == sorted(alone.split())
    assert net.driver.read([down(net, 0)])[down(net, 0)].cell_bps == 0


def bad() -> LinkShape:
    """A shape that `tc` refuses at its last class, when the others are changed already."""
    good = ladder.shape(1_000_000, 0, ceil_bps=CELL_BPS, cell_bps=CELL_BPS // 2)
    over = dict(good.classes)
    over[TrafficClass.BACKGROUND] = ClassShape(250_000, CELL_BPS, -1)
    return LinkShape(1_000_000, over, cell_bps=CELL_BPS // 2)


def test_a_refusal_halfway_leaves_all_as_it_was(net: Links) -> None:
    before = state(net.device(net.robots[0]))
    with pytest.raises(NetworkError, match=r"prio -1.*|classid 1:130"):
        net.driver.apply(down(net, 0), bad())
    assert state(net.device(net.robots[0])) == before
    assert ifbs() == []
    share(net, {0: 5_000_000, 1: 5_000_000})
    before = state(ifb_of(net.bridge))
    with pytest.raises(NetworkError, match=r"prio -1.*|classid 1:130"):
        net.driver.apply(down(net, 0), bad())
    assert state(ifb_of(net.bridge)) == before
    send(net, net.robots[0], 50_000, TrafficClass.FUSION.tos)


@pytest.mark.parametrize(
    "tampering",
    [
        "tc qdisc del dev {tree} root",
        "tc filter del dev {tree} parent 1: pref 1",
        "tc qdisc del dev {device} clsact",
        "ip link del {tree}",
        "tc class change dev {tree} parent 1: classid 1:1 htb rate 1mbit ceil 1mbit",
    ],
)
def test_what_somebody_else_did_to_the_tree_is_found_and_mended(net: Links, tampering: str) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000})
    both = [down(net, 0), down(net, 1)]
    tree, device = ifb_of(net.bridge), net.device(net.robots[0])
    must(*tampering.format(tree=tree, device=device).split())
    readings = net.driver.read(both)
    if "filter" not in tampering:
        assert down(net, 0) not in readings or readings[down(net, 0)].cell_bps != CELL_BPS
    share(net, {0: 5_000_000, 1: 5_000_000})
    assert {r.cell_bps for r in net.driver.read(both).values()} == {CELL_BPS}
    for i in range(2):
        send(net, net.robots[i], 50_000, TrafficClass.FUSION.tos)
        fusion = net.driver.read([down(net, i)])[down(net, i)].classes[TrafficClass.FUSION]
        assert fusion.sent_bytes > 50_000


def test_an_ifb_device_of_somebody_else_is_neither_used_nor_removed(net: Links) -> None:
    foreign = ifb_of(net.bridge)
    must("ip", "link", "add", foreign, "type", "ifb")
    try:
        with pytest.raises(NetworkError, match=f"{foreign}.* is not the swarm's"):
            share(net, {0: 5_000_000})
        net.driver.clear(down(net, 0))
        net.driver.close()
        assert foreign in ifbs()
    finally:
        must("ip", "link", "del", foreign)


@pytest.mark.parametrize("alone", [True, False])
def test_the_place_of_a_link_that_is_gone_is_given_back(net: Links, alone: bool) -> None:
    robot, device = net.robots[2], net.device(net.robots[2])
    share(net, {2: 5_000_000} if alone else {2: 5_000_000, 1: 5_000_000})
    must("ip", "link", "del", device)
    try:
        net.driver.robots()
        assert ifbs() == ([] if alone else [ifb_of(net.bridge)])
        assert net.driver.shaped() == (frozenset() if alone else {down(net, 1)})
    finally:
        add_link(device, robot, "10.77.1.3")


def test_what_a_killed_controller_left_goes_with_the_next_one(net: Links) -> None:
    share(net, {2: 5_000_000})
    must("ip", "link", "del", net.device(net.robots[2]))
    try:
        net.again().close()
        assert ifbs() == []
    finally:
        add_link(net.device(net.robots[2]), net.robots[2], "10.77.1.3")


def test_sweeping_takes_the_trees_of_bridges_that_are_gone(net: Links) -> None:
    share(net, {0: 5_000_000})
    make_ifb(ifb_of("br-0123456789ab"), "br-0123456789ab")
    assert len(ifbs()) == 2
    assert sweep.main() == 0
    assert ifbs() == [ifb_of(net.bridge)]
    assert net.driver.shaped() == {down(net, 0)}


def test_borrowed_bits_are_given_back_at_once(net: Links) -> None:
    share(net, {0: 5_000_000, 1: 5_000_000})
    with floods(net, {0: TrafficClass.FUSION}, 2 * FLOOD_S):
        with floods(net, {1: TrafficClass.FUSION}):
            must_carry(net, {0: 5_000_000, 1: 5_000_000})
        # What is left of the other's queue is gone in a tenth of a second.
        must_carry(net, {0: CELL_BPS})
