"""Links in namespaces, shaped by the real `tc`."""

from __future__ import annotations

import json
import re
import socket
import sys

import pytest

from deploy.netns import launch
from network_controller import ladder
from network_controller.drivers import shaping
from network_controller.drivers.ifbs import MAX_NAME, ifb_of
from network_controller.drivers.netns import NetnsDriver
from network_controller.model import DIRECTIONS, ClassShape, Link, LinkShape
from swarm.errors import LinkGoneError, NetworkError
from swarm.messages import Direction
from swarm.traffic import TrafficClass
from tests.support.link_support import Links, add_link, fill, must, send

RATE = 50_000_000


def state(device: str) -> str:
    """All that `tc` shows of a device's shape, without counters and the kernel's own handles."""
    shown = "".join(
        must("tc", what, "show", "dev", device, *more)
        for what, *more in (
            ["qdisc"],
            ["class"],
            ["filter"],
            ["filter", "ingress"],
            ["filter", "egress"],
        )
    )
    return re.sub(r"\b[0-9a-f]{4}:(?= )", "own:", shown)


def bad(rate_bps: int = RATE) -> LinkShape:
    """A shape that `tc` refuses at its third class, when the first two are changed already."""
    good = ladder.shape(rate_bps, 0)
    over = dict(good.classes)
    over[TrafficClass.BACKGROUND] = ClassShape(rate_bps // 4, rate_bps, -1)
    return LinkShape(rate_bps, over)


def test_robots_are_the_namespaces_on_the_bridge(net: Links) -> None:
    found = net.driver.robots()
    assert found == {robot: f"10.77.1.{i + 1}" for i, robot in enumerate(net.robots)}


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_what_is_read_back_is_what_was_applied(net: Links, direction: Direction) -> None:
    link = Link(net.robots[0], direction)
    for level in (0, ladder.TOP):
        shape = ladder.shape(5_412_345, level)
        net.driver.apply(link, shape)
        reading = net.driver.read([link])[link]
        assert reading.capacity_bps == pytest.approx(shape.capacity_bps, rel=0.01)
        for traffic, wanted in shape.classes.items():
            have = reading.classes[traffic].shape
            assert have.rate_bps == pytest.approx(wanted.rate_bps, rel=0.01)
            assert have.ceil_bps == pytest.approx(wanted.ceil_bps, rel=0.01)
            assert have.priority == wanted.priority


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("traffic", TrafficClass)
def test_traffic_goes_through_the_class_of_its_mark(
    net: Links, direction: Direction, traffic: TrafficClass
) -> None:
    robot = net.robots[0]
    link, other = Link(robot, direction), Link(robot, "up" if direction == "down" else "down")
    net.driver.apply(link, ladder.shape(RATE, 0))
    size = 200_000
    to, frm = (robot, "") if direction == "down" else ("", robot)
    send(net, to, size, traffic.tos, frm=frm)
    classes = net.driver.read([link, other])[link].classes
    assert classes[traffic].sent_bytes > size
    assert all(c.sent_bytes < size for t, c in classes.items() if t is not traffic)


def test_unmarked_traffic_is_background(net: Links) -> None:
    link = Link(net.robots[0], "down")
    net.driver.apply(link, ladder.shape(RATE, 0))
    send(net, net.robots[0], 100_000, 0)
    assert net.driver.read([link])[link].classes[TrafficClass.BACKGROUND].sent_bytes > 100_000


def test_robots_reach_each_other_through_both_shaped_directions(net: Links) -> None:
    sender, receiver, _ = net.robots
    both = [Link(sender, "up"), Link(receiver, "down")]
    for link in both:
        net.driver.apply(link, ladder.shape(RATE, 0))
    send(net, receiver, 100_000, TrafficClass.FUSION.tos, frm=sender)
    for reading in net.driver.read(both).values():
        assert reading.classes[TrafficClass.FUSION].sent_bytes > 100_000


def test_a_change_keeps_what_queues_hold_and_what_was_counted(net: Links) -> None:
    link = Link(net.robots[0], "down")
    # So slow that it takes half a minute to drain.
    net.driver.apply(link, ladder.shape(10_000, 0))
    fill("10.77.1.1", 40_000, TrafficClass.FUSION.tos)
    before = net.driver.read([link])[link].classes[TrafficClass.FUSION]
    assert before.backlog_bytes > 20_000
    for rate_bps, level in ((15_000, 2), (12_000, 3)):
        net.driver.apply(link, ladder.shape(rate_bps, level))
    after = net.driver.read([link])[link].classes[TrafficClass.FUSION]
    assert after.drops == before.drops
    # Whatever is not waiting any more was sent; tc rounds long queues to 1 kB.
    total = before.backlog_bytes + before.sent_bytes
    assert after.backlog_bytes > 0
    assert after.backlog_bytes + after.sent_bytes == pytest.approx(total, abs=2048)


def test_a_new_driver_finds_what_was_shaped_and_goes_on_from_there(net: Links) -> None:
    wanted = {Link(net.robots[0], "up"), Link(net.robots[1], "down")}
    for link in wanted:
        net.driver.apply(link, ladder.shape(RATE, 1))
    later = net.again()
    assert later.shaped() == wanted
    for link in wanted:
        later.apply(link, ladder.shape(RATE // 2, 0))
        assert later.read([link])[link].capacity_bps == RATE // 2


def test_clearing_is_complete_and_may_be_repeated(net: Links) -> None:
    robot = net.robots[0]
    before = state(net.device(robot))
    for direction in DIRECTIONS:
        net.driver.apply(Link(robot, direction), ladder.shape(RATE, 0))
    for _ in range(2):
        for direction in DIRECTIONS:
            net.driver.clear(Link(robot, direction))
    assert state(net.device(robot)) == before
    assert not net.driver.shaped()
    assert json.loads(must("ip", "-j", "link", "show", "type", "ifb")) == []
    net.driver.clear(Link("nobody", "down"))


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_refusal_halfway_leaves_an_unshaped_link_unshaped(
    net: Links, direction: Direction
) -> None:
    link = Link(net.robots[0], direction)
    before = state(net.device(link.robot))
    with pytest.raises(NetworkError, match=r"prio -1.*|classid 1:30"):
        net.driver.apply(link, bad())
    assert state(net.device(link.robot)) == before
    assert not net.driver.shaped()


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_refusal_halfway_leaves_a_shaped_link_as_it_was(net: Links, direction: Direction) -> None:
    link = Link(net.robots[0], direction)
    device = net.device(link.robot)
    target = device if direction == "down" else ifb_of(device)
    net.driver.apply(link, ladder.shape(RATE, 2))
    before = state(target)
    with pytest.raises(NetworkError, match="classid 1:30"):
        net.driver.apply(link, bad(RATE // 10))
    assert state(target) == before
    to, frm = (link.robot, "") if direction == "down" else ("", link.robot)
    send(net, to, 50_000, TrafficClass.FUSION.tos, frm=frm)


@pytest.mark.parametrize(
    "tampering",
    [
        "class change dev {} parent 1:1 classid 1:20 htb rate 1mbit ceil 2mbit prio 5",
        "filter del dev {} parent 1: prio 2",
        "class del dev {} classid 1:10",
        "qdisc replace dev {} parent 1:20 pfifo limit 7",
        "qdisc del dev {} root",
    ],
)
def test_what_somebody_else_did_to_a_shape_is_mended(net: Links, tampering: str) -> None:
    link = Link(net.robots[0], "down")
    shape = ladder.shape(RATE, 0)
    net.driver.apply(link, shape)
    whole = state(net.device(link.robot))
    if "class del" in tampering:
        must("tc", "filter", "del", "dev", net.device(link.robot), "parent", "1:")
    must("tc", "-batch", "-", text=tampering.format(net.device(link.robot)) + "\n")
    net.driver.apply(link, shape)
    assert sorted(state(net.device(link.robot)).split()) == sorted(whole.split())


def test_traffic_from_a_robot_is_shaped_again_after_its_redirection_was_lost(net: Links) -> None:
    link = Link(net.robots[0], "up")
    device = net.device(link.robot)
    losses = (
        ("tc", "qdisc", "del", "dev", device, "clsact"),
        ("ip", "link", "del", ifb_of(device)),
    )
    for loss in losses:
        net.driver.apply(link, ladder.shape(RATE, 0))
        must(*loss)
        assert link not in net.driver.read([link])
        net.driver.apply(link, ladder.shape(RATE, 0))
        send(net, "", 50_000, TrafficClass.FUSION.tos, frm=link.robot)
        classes = net.driver.read([link])[link].classes
        assert classes[TrafficClass.FUSION].sent_bytes > 50_000


def test_delay_is_refused_with_the_kernels_words_where_it_has_no_netem(net: Links) -> None:
    missing = net.driver.capabilities().missing
    link = Link(net.robots[0], "down")
    shape = ladder.shape(RATE, 0, delay_ms=20.0, loss=0.01)
    if "netem" in missing:
        with pytest.raises(NetworkError, match="delay and loss need netem") as refusal:
            net.driver.apply(link, shape)
        assert missing["netem"] in str(refusal.value)
        assert not net.driver.shaped()
    else:
        net.driver.apply(link, ladder.shape(RATE, 0))
        net.driver.apply(link, shape)
        reading = net.driver.read([link])[link]
        assert (reading.delay_ms, reading.loss) == pytest.approx((20.0, 0.01))


def test_capabilities_are_tried_on_devices_that_are_gone_afterwards(net: Links) -> None:
    before = socket.if_nameindex()
    found = net.again().capabilities()
    assert {"htb", "bfifo", "u32", "clsact", "mirred", "ifb"} <= found.present
    assert all(found.missing.values())
    assert [name for _, name in socket.if_nameindex()] == [name for _, name in before]


def test_interfaces_that_are_not_on_the_bridge_are_left_alone(net: Links) -> None:
    robot = net.robots[2]
    device = net.device(robot)
    net.driver.robots()
    must("ip", "link", "set", device, "nomaster")
    try:
        before = state(device)
        with pytest.raises(NetworkError, match="no longer hangs on the swarm's bridge coadapt0"):
            net.driver.apply(Link(robot, "down"), ladder.shape(RATE, 0))
        assert robot not in net.again().robots()
        with pytest.raises(LinkGoneError, match=robot):
            net.again().apply(Link(robot, "down"), ladder.shape(RATE, 0))
        assert state(device) == before
    finally:
        must("ip", "link", "set", device, "master", "coadapt0")


def test_an_ifb_device_of_somebody_else_is_neither_used_nor_removed(net: Links) -> None:
    link = Link(net.robots[0], "up")
    foreign = ifb_of(net.device(link.robot))
    must("ip", "link", "add", foreign, "type", "ifb")
    try:
        with pytest.raises(NetworkError, match=f"{foreign}.* is not the swarm's"):
            net.driver.apply(link, ladder.shape(RATE, 0))
        net.driver.clear(link)
        net.driver.close()
        assert socket.if_nametoindex(foreign)
    finally:
        must("ip", "link", "del", foreign)


def test_a_link_that_was_made_anew_is_found_and_shaped_anew(net: Links) -> None:
    robot = net.robots[2]
    device = net.device(robot)
    both = [Link(robot, direction) for direction in DIRECTIONS]
    for link in both:
        net.driver.apply(link, ladder.shape(RATE, 0))
    must("ip", "link", "del", device)
    assert not net.driver.read(both)
    with pytest.raises(LinkGoneError, match=robot):
        net.driver.apply(both[0], ladder.shape(RATE, 0))
    add_link(device, robot, "10.77.1.77")
    assert net.driver.robots()[robot] == "10.77.1.77"
    assert not net.driver.read(both)
    for link in both:
        net.driver.apply(link, ladder.shape(RATE, 0))
    send(net, "", 50_000, TrafficClass.FUSION.tos, frm=robot)
    sent = net.driver.read(both)[both[1]].classes[TrafficClass.FUSION].sent_bytes
    assert sent > 50_000


@pytest.mark.parametrize("later", [False, True])
def test_what_outlives_a_link_is_removed(net: Links, later: bool) -> None:
    robot = net.robots[2]
    net.driver.apply(Link(robot, "up"), ladder.shape(RATE, 0))
    must("ip", "link", "del", net.device(robot))
    try:
        if later:
            net.again().close()
        else:
            net.driver.robots()
        assert json.loads(must("ip", "-j", "link", "show", "type", "ifb")) == []
    finally:
        add_link(net.device(robot), robot, "10.77.1.3")


def test_a_device_that_vanishes_while_many_are_read_costs_only_itself(net: Links) -> None:
    for robot in net.robots[:2]:
        net.driver.apply(Link(robot, "down"), ladder.shape(RATE, 0))
    names = [net.device(net.robots[0]), "vanished", net.device(net.robots[1])]
    found = shaping.read([(name, "down") for name in names])
    assert {name for name, _ in found} == {names[0], names[2]}
    with pytest.raises(LinkGoneError, match="interface vanished has vanished"):
        shaping.Shaper("links").apply("vanished", "down", ladder.shape(RATE, 0))


def test_programs_run_in_the_robots_namespace(net: Links) -> None:
    robot = net.robots[0]
    program = (
        "import socket, sys; s = socket.socket(); s.bind(('10.77.1.1', 0)); "
        "sys.exit(3 if 'link1' not in [n for _, n in socket.if_nameindex()] else 4)"
    )
    running = net.driver.start_at(robot, [sys.executable, "-c", program])
    assert running.wait(timeout=20) == 3
    assert running.poll() == 3
    with pytest.raises(LinkGoneError, match="nobody"):
        net.driver.start_at("nobody", ["true"])


def test_names_of_devices_fit_and_differ_for_long_links() -> None:
    names = {ifb_of(f"verylongname-{i}") for i in range(5)} | {ifb_of("link1")}
    assert len(names) == 6
    assert all(len(name) <= MAX_NAME for name in names)
    assert ifb_of("veth1234567") == "ifb-veth1234567"


def test_without_a_bridge_there_are_no_robots() -> None:
    assert NetnsDriver("links", bridge="no-bridge-here").robots() == {}


def test_without_the_right_to_shape_the_kernels_words_and_the_remedy_are_told(net: Links) -> None:
    program = (
        "from network_controller.drivers.netns import NetnsDriver\n"
        "from swarm.errors import NetworkError\n"
        "try:\n NetnsDriver('links').capabilities()\n"
        "except NetworkError as error:\n print(error)\n"
    )
    told = must("setpriv", "--bounding-set", "-net_admin", sys.executable, "-c", program)
    assert "Operation not permitted" in told
    assert "the controller needs NET_ADMIN" in told


def test_in_a_users_own_namespaces_both_directions_can_be_shaped() -> None:
    program = (
        "from network_controller.drivers.netns import NetnsDriver\n"
        "found = NetnsDriver('links').capabilities().present\n"
        "print(found >= {'htb', 'bfifo', 'u32', 'clsact', 'mirred', 'ifb'})\n"
    )
    own = ("unshare", "--user", "--map-root-user", "--net", "--mount")
    refused = launch.why_not()
    if refused is not None:
        pytest.skip(refused)
    assert must(*own, sys.executable, "-c", program).strip() == "True"
