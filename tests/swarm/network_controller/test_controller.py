"""What the controller does when links, kernel, disk or operators get in its way.

The driver here keeps shapes in memory and refuses on demand; the drivers' own tests and the tests
end to end have the kernel's.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest
from prometheus_client import CollectorRegistry

from network_controller import ladder
from network_controller.controller import RENEW_LOOKS, Controller
from network_controller.drivers.base import Running
from network_controller.journal import Journal
from network_controller.metrics import ControllerMetrics
from network_controller.model import (
    FEATURES,
    Capabilities,
    ClassReading,
    Link,
    LinkReading,
    LinkShape,
)
from network_controller.observe import CLASS_NAMES
from network_controller.slow_loop import SlowLoop
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wishes
from swarm.errors import LinkGoneError, NetworkError
from swarm.log import make_logger
from swarm.messages import LinkState, NetDemand, ShapeReply, ShapeRequest
from tests.support.zenoh_fixtures import Inbox, until

CELL = Link("R1", "down")


class Memory:
    """A driver whose kernel is a dictionary."""

    name = "memory"
    one_tree = True

    def __init__(self) -> None:
        self.present = {"R1": "10.0.0.1", "R2": "10.0.0.2"}
        self.shapes: dict[Link, LinkShape] = {}
        self.refused: dict[Link, str] = {}
        self.unable = ""
        self.missing: dict[str, str] = {}
        self.sent = self.backlog = 0
        self.applied: list[Link] = []

    def robots(self) -> Mapping[str, str]:
        return dict(self.present)

    def capabilities(self) -> Capabilities:
        if self.unable:
            raise NetworkError(self.unable)
        return Capabilities(frozenset(FEATURES) - self.missing.keys(), self.missing)

    def apply(self, link: Link, shape: LinkShape) -> None:
        if link.robot not in self.present:
            raise LinkGoneError(f"{link} is gone")
        if link in self.refused:
            raise NetworkError(self.refused[link])
        self.applied.append(link)
        self.shapes[link] = shape

    def read(self, links: Collection[Link]) -> Mapping[Link, LinkReading]:
        return {
            link: LinkReading(
                shape.capacity_bps,
                {
                    t: ClassReading(one, self.sent, self.backlog, 0, 0)
                    for t, one in shape.classes.items()
                },
                shape.delay_ms,
                shape.loss,
                shape.cell_bps,
            )
            for link, shape in self.shapes.items()
            if link in links and link.robot in self.present
        }

    def clear(self, link: Link) -> None:
        self.shapes.pop(link, None)

    def shaped(self) -> frozenset[Link]:
        return frozenset(self.shapes)

    def start_at(self, robot: str, argv: list[str]) -> Running:
        raise LinkGoneError(f"{robot} is gone")

    def close(self) -> None:
        return

    def rate(self, link: Link = CELL) -> int | None:
        return self.shapes[link].capacity_bps if link in self.shapes else None


class Site:
    """A controller on that driver."""

    def __init__(self, directory: Path, cell: tuple[str, ...] = ()) -> None:
        self.cell = cell
        self.driver = Memory()
        self.directory = directory
        self.lost: list[str] = []
        self.journal: Journal | None = None
        self.controller = self.again()

    def again(self) -> Controller:
        """A controller after the last one was killed."""
        if self.journal is not None:
            self.journal.close()
        self.journal = Journal(self.directory / "actions.jsonl")
        self.loop = SlowLoop()
        self.registry = CollectorRegistry()
        controller = Controller(
            self.driver,
            Wishes(self.directory / "shapes.json", 0),
            self.loop,
            Flows(self.driver),
            ControllerMetrics(self.registry),
            self.journal,
            make_logger("test", level="critical"),
            ego="R1",
            others=self.cell[1:],
            cell=self.cell,
        )
        controller.on_lost = self.lost.append
        controller.start()
        self.controller = controller
        return controller

    def ask(self, profile: Any = "rate", **fields: Any) -> ShapeReply:
        return self.controller.request(ShapeRequest(profile=profile, operator="anna", **fields))

    def step(self) -> dict[Link, LinkState]:
        self.controller.follow()
        states = self.controller.observe()
        self.controller.follow()
        return {Link(state.robot, state.direction): state for state in states}

    def actions(self) -> list[str]:
        lines = (self.directory / "actions.jsonl").read_text().splitlines()
        return [json.loads(line)["action"] for line in lines]


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


def test_a_request_for_both_directions_is_carried_out_whole_or_not_at_all(site: Site) -> None:
    site.ask(rate_bps=5_000_000, direction="both", robot="R2")
    site.driver.refused[Link("R2", "up")] = "RTNETLINK answers: no"
    with pytest.raises(NetworkError, match="answers: no"):
        site.ask(rate_bps=1_000_000, direction="both", robot="R2")
    assert site.driver.rate(Link("R2", "down")) == 5_000_000
    assert site.driver.rate(Link("R2", "up")) == 5_000_000
    reply = site.ask("show")
    assert (reply.revision, [s.rate_bps for s in reply.shapes]) == (1, [5_000_000] * 2)
    assert "refused" in site.actions()


def test_a_request_that_cannot_be_kept_is_undone(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    (site.directory / "shapes.json").unlink()
    (site.directory / "shapes.json").mkdir()
    with pytest.raises(NetworkError, match="cannot be kept"):
        site.ask(rate_bps=1_000_000)
    assert site.driver.rate() == 5_000_000
    assert site.ask("show").revision == 1


def test_a_link_that_cannot_be_shaped_yet_is_tried_again(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    site.driver.shapes.clear()
    site.driver.refused[CELL] = "RTNETLINK answers: not now"
    site.step()
    assert "not now" in site.ask("show").notes[0]
    assert site.ask("show").shapes[0].rate_bps == 0
    del site.driver.refused[CELL]
    site.step()
    assert site.driver.rate() == 5_000_000
    assert site.ask("show").notes == ()


def test_a_robot_that_leaves_and_comes_back_is_shaped_again(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    robot = site.driver.present.pop("R1")
    site.driver.shapes.clear()
    assert site.step() == {}
    assert "link_gone" in site.actions()
    site.driver.present["R1"] = robot
    site.step()
    assert site.driver.rate() == 5_000_000


def test_what_somebody_else_changes_is_put_right(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    site.driver.shapes[CELL] = ladder.shape(1_000_000, 0)
    site.step()
    assert site.driver.rate() == 5_000_000
    assert "shape_changed" in site.actions()


def test_the_next_controller_adopts_what_is_wanted_with_its_level_and_clears_the_rest(
    site: Site,
) -> None:
    site.ask(rate_bps=5_000_000)
    site.driver.shapes[CELL] = ladder.shape(5_000_000, 2)
    site.driver.shapes[Link("R2", "up")] = ladder.shape(1_000_000, 0)
    site.again()
    assert site.driver.shapes == {CELL: ladder.shape(5_000_000, 2)}
    assert site.loop.level(CELL) == 2
    assert {"adopted", "cleared"} <= set(site.actions())


def test_a_controller_that_stops_leaves_no_link_shaped_and_the_next_one_shapes_them_again(
    site: Site,
) -> None:
    site.ask(rate_bps=5_000_000)
    site.controller.close()
    assert site.driver.shapes == {}
    site.again()
    assert site.driver.rate() == 5_000_000


def test_without_rights_every_request_says_why_and_the_wish_is_carried_out_once_it_may(
    site: Site,
) -> None:
    site.ask(rate_bps=5_000_000)
    site.controller.close()
    site.driver.unable = "Operation not permitted; the controller needs NET_ADMIN"
    site.again()
    with pytest.raises(NetworkError, match="needs NET_ADMIN"):
        site.ask(rate_bps=1_000_000)
    assert "NET_ADMIN" in site.ask("show").notes[0]
    assert "NET_ADMIN" in site.controller.troubles()[0]
    assert site.controller.robots() == ("R1", "R2")
    site.driver.unable = ""
    site.step()
    assert site.driver.rate() == 5_000_000
    assert site.controller.troubles() == ()


def test_two_sessions_hold_the_higher_level_and_the_last_one_lets_go(site: Site) -> None:
    with pytest.raises(NetworkError, match="not shaped"):
        site.controller.hold("a", "R1", 1)
    site.ask(rate_bps=5_000_000)
    site.controller.hold("a", "R1", 1)
    site.controller.hold("b", "R1", 3)
    assert site.step()[CELL].level == 3
    site.controller.release("b")
    site.controller.release("b")
    assert site.driver.shapes[CELL] == ladder.shape(5_000_000, 1)
    site.controller.release("a")
    assert site.driver.shapes[CELL] == ladder.shape(5_000_000, 0)


def test_a_hold_that_the_kernel_refuses_is_none(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    site.driver.refused[CELL] = "no"
    with pytest.raises(NetworkError):
        site.controller.hold("a", "R1", 3)
    site.driver.refused.clear()
    assert site.step()[CELL].level == 0


def test_a_link_that_is_not_shaped_any_more_is_told_of_and_starts_at_level_0(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    site.loop.levels[CELL] = 2
    stop = threading.Event()
    states: Inbox[tuple[LinkState, ...]] = Inbox()
    worker = threading.Thread(target=site.controller.run, args=(stop, states.put))
    worker.start()
    try:
        assert states.next_where(lambda s: bool(s))[0].level == 2
        site.ask("off")
        states.next_where(lambda s: not s)
    finally:
        stop.set()
        site.controller.wake()
        worker.join()
    assert site.lost == ["R1"]
    assert site.loop.level(CELL) == 0


def test_egos_share_what_comes_from_a_robot(site: Site) -> None:
    site.ask(rate_bps=4_000_000, robot="R2", direction="up")
    for ego in ("R1", "R3"):
        site.controller.on_demand(demand(ego))
    (state,) = site.step().values()
    assert state.grants == {"R1": 2_000_000, "R3": 2_000_000}


def test_demands_and_links_that_are_gone_leave_no_series_behind(site: Site) -> None:
    site.ask(rate_bps=4_000_000)
    site.step()
    labels = {"robot": "R1", "direction": "down"}
    assert site.registry.get_sample_value("coadapt_net_capacity_bps", labels) == 4_000_000
    site.ask("off")
    site.step()
    assert site.registry.get_sample_value("coadapt_net_capacity_bps", labels) is None
    traffic = labels | {"traffic": "fusion"}
    assert site.registry.get_sample_value("coadapt_net_class_rate_bps", traffic) is None


def test_the_journal_closes_off_a_line_that_a_crash_tore(tmp_path: Path) -> None:
    path = tmp_path / "actions.jsonl"
    path.write_text(json.dumps({"action": "shaped"}) + '\n{"action": "rai')
    journal = Journal(path)
    journal.note(1, "lowered", "because", level=0)
    journal.close()
    lines = path.read_text().splitlines()
    assert len(lines) == 3
    assert json.loads(lines[2]) == {
        "time_ns": 1,
        "action": "lowered",
        "level": 0,
        "reason": "because",
    }


def demand(ego: str) -> NetDemand:
    return NetDemand(
        ego=ego,
        cycle=1,
        sent_ns=0,
        needed_bytes_s=100_000,
        possible=True,
        reachable=True,
        unreachable_s=0.0,
        quality=0.9,
        q_min=0.7,
        capacity_bps=1_000_000,
    )


def test_a_shape_that_somebody_changed_is_cleared_when_it_expires(site: Site) -> None:
    site.ask(rate_bps=5_000_000, duration_s=0.1)
    site.driver.shapes[CELL] = ladder.shape(1_000_000, 0)
    site.controller.observe()
    assert "shape_changed" in site.actions()
    until(lambda: site.step() == {} and site.driver.rate() is None, "the link is unshaped")


def test_a_link_that_only_looks_right_is_shaped_again_before_long(site: Site) -> None:
    site.ask(rate_bps=5_000_000, direction="both")
    site.driver.applied.clear()
    for _ in range(2 * RENEW_LOOKS):
        site.controller.observe()
    assert sorted(site.driver.applied) == sorted([CELL, Link("R1", "up")])


def test_what_an_earlier_controller_shaped_is_taken_over_as_soon_as_links_can_be_shaped(
    site: Site,
) -> None:
    site.ask(rate_bps=5_000_000)
    left = Link("R2", "up")
    site.driver.shapes[left] = ladder.shape(9_000_000, 0)
    site.loop.levels[CELL] = 2
    site.step()
    site.driver.unable = "no NET_ADMIN"
    site.again()
    assert left in site.driver.shapes
    site.driver.unable = ""
    site.step()
    assert site.step()[CELL].level == 2
    assert left not in site.driver.shapes


def test_a_half_of_a_shape_that_an_earlier_controller_left_is_made_whole(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    site.driver.applied.clear()
    site.again()
    assert CELL in site.driver.applied


def test_losing_a_robots_upward_link_is_not_losing_its_cell(site: Site) -> None:
    site.ask(rate_bps=5_000_000, direction="both")
    site.ask("off", direction="up")
    site.controller._tell_lost()
    assert site.lost == []
    site.ask("off")
    site.controller._tell_lost()
    assert site.lost == ["R1"]


def test_off_ends_the_shapes_of_its_direction_and_of_robots_that_have_left(site: Site) -> None:
    site.ask(rate_bps=5_000_000, direction="both")
    site.ask(rate_bps=6_000_000, robot="R2")
    del site.driver.present["R2"]
    site.step()
    shapes = site.ask("off", direction="up").shapes
    assert {(one.robot, one.direction) for one in shapes} == {("R1", "down"), ("R2", "down")}
    shapes = site.ask("off", robot="R2").shapes
    assert [one.robot for one in shapes] == ["R1"]
    with pytest.raises(NetworkError, match="'R2' has no link"):
        site.ask("off", robot="R2")


def test_ending_telemetry_where_none_runs_says_so_and_keeps_the_shape(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    reply = site.ask("relieve")
    assert reply.notes == ("no telemetry was running there",)
    assert [shape.rate_bps for shape in reply.shapes] == [5_000_000]
    with pytest.raises(NetworkError, match="'R9' has no link"):
        site.ask("relieve", robot="R9")


def test_a_controller_that_has_closed_shapes_nothing_more(site: Site) -> None:
    site.ask(rate_bps=5_000_000)
    site.controller.close()
    with pytest.raises(NetworkError, match="ending"):
        site.ask(rate_bps=6_000_000)
    with pytest.raises(NetworkError, match="ending"):
        site.controller.hold("s", "R1", 1)
    site.controller.follow()
    assert site.driver.rate() is None


def test_a_trace_may_not_change_a_link_faster_than_the_kernel_is_changed(site: Site) -> None:
    with pytest.raises(NetworkError, match=r"interval_s / time_scale is 0\.01 s"):
        site.ask("trace", rates_bps=(10**6, 10**7), interval_s=1.0, time_scale=100.0)


def test_what_a_delay_holds_does_not_count_as_waiting(site: Site) -> None:
    site.ask(rate_bps=10_000_000, delay_ms=200.0)
    site.step()
    site.driver.backlog = 60_000
    assert site.step()[CELL].latency_ms > 200.0
    site.driver.sent = 10**9
    assert site.step()[CELL].latency_ms == 200.0


def test_what_is_configured_is_published_at_once(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("network_controller.controller.STATE_S", 3600.0)
    published: Inbox[tuple[LinkState, ...]] = Inbox()
    stop = threading.Event()
    worker = threading.Thread(target=site.controller.run, args=(stop, published.put))
    worker.start()
    try:
        assert published.next() == ()
        for rate_bps in (20_000_000, 5_000_000):
            site.ask(rate_bps=rate_bps)
            assert [state.capacity_bps for state in published.next()] == [rate_bps]
        site.ask("off")
        assert published.next() == ()
    finally:
        stop.set()
        site.controller.wake()
        worker.join()


def test_a_state_between_two_looks_keeps_the_throughput_of_the_last_second(site: Site) -> None:
    site.ask(rate_bps=10_000_000)
    site.step()
    site.driver.sent = 10**6
    (before,) = site.controller.observe()
    site.driver.sent = 10**9
    (between,) = site.controller.observe(between=True)
    fusion = between.classes["fusion"]
    assert fusion.throughput_bps == before.classes["fusion"].throughput_bps > 0
    assert fusion.sent_bytes == 10**9
    (after,) = site.controller.observe()
    assert after.classes["fusion"].throughput_bps > fusion.throughput_bps


def test_a_state_tells_the_level_of_the_classes_that_it_tells(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    site.ask(rate_bps=1_000_000)
    now_s = 0.0
    monkeypatch.setattr("network_controller.controller.time.monotonic", lambda: now_s)
    short = msgspec.structs.replace(demand("R1"), needed_bytes_s=10**6, unreachable_s=5.0)
    told = set()
    while ladder.TOP not in told:
        now_s += 5.0
        site.controller.on_demand(short)
        (state,) = site.controller.observe()
        wanted = ladder.shape(1_000_000, state.level).classes
        assert {name: (one.rate_bps, one.priority) for name, one in state.classes.items()} == {
            CLASS_NAMES[traffic]: (one.rate_bps, one.priority) for traffic, one in wanted.items()
        }
        told.add(state.level)
    assert told == set(range(ladder.TOP + 1))


def test_links_of_egos_that_share_a_cell_have_its_parts_and_say_so(tmp_path: Path) -> None:
    site = Site(tmp_path, cell=("R1", "R2"))
    site.ask(rate_bps=8_000_000)
    states = site.step()
    assert [states[Link(ego, "down")].capacity_bps for ego in ("R1", "R2")] == [4_000_000] * 2
    for ego, needed_bytes_s in (("R1", 750_000), ("R2", 0)):
        told = msgspec.structs.replace(demand(ego), needed_bytes_s=needed_bytes_s)
        site.controller.on_demand(told)
    site.step()
    states = site.step()
    assert states[Link("R1", "down")].capacity_bps == 7_000_000
    assert states[Link("R2", "down")].grants == {"R1": 7_000_000, "R2": 1_000_000}
    # What it leaves unused for a moment the others may have.
    assert {shape.cell_bps for shape in site.driver.shapes.values()} == {8_000_000}
    assert {shape.ceil_bps for shape in site.driver.shapes.values()} == {8_000_000}
    # A link that is not an ego's is nobody's part.
    site.ask(rate_bps=3_000_000, robot="R2", direction="up")
    assert site.driver.rate(Link("R2", "up")) == 3_000_000
    assert site.driver.shapes[Link("R2", "up")].cell_bps == 0


def test_a_station_that_is_far_has_its_part_of_the_time_at_its_own_rate(tmp_path: Path) -> None:
    site = Site(tmp_path, cell=("R1", "R2"))
    site.ask(rate_bps=54_000_000)
    site.ask(rate_bps=12_000_000, robot="R2")
    site.driver.backlog = 1
    site.step()
    near, far = (site.driver.shapes[Link(ego, "down")] for ego in ("R1", "R2"))
    assert (near.capacity_bps, near.ceil_bps, near.cell_bps) == (27e6, 54e6, 33e6)
    assert (far.capacity_bps, far.ceil_bps, far.cell_bps) == (6e6, 12e6, 33e6)
    # It comes nearer.
    site.ask(rate_bps=36_000_000, robot="R2")
    site.step()
    near, far = (site.driver.shapes[Link(ego, "down")] for ego in ("R1", "R2"))
    assert (near.capacity_bps, near.cell_bps) == (27e6, 45e6)
    assert (far.capacity_bps, far.ceil_bps, far.cell_bps) == (18e6, 36e6, 45e6)


def test_where_no_tree_can_be_made_egos_have_their_parts_and_that_is_told(tmp_path: Path) -> None:
    site = Site(tmp_path, cell=("R1", "R2"))
    site.driver.missing = {"clsact": "Error: no such thing"}
    site.again()
    site.ask(rate_bps=8_000_000)
    states = site.step()
    assert [states[Link(ego, "down")].capacity_bps for ego in ("R1", "R2")] == [4_000_000] * 2
    assert all(not shape.cell_bps for shape in site.driver.shapes.values())
    assert all(shape.ceil_bps == 4_000_000 for shape in site.driver.shapes.values())
    (note,) = site.ask("show").notes
    assert "egos of the cell lend each other nothing: clsact (Error: no such thing)" in note
    assert site.actions().count("lends_nothing") == 1
    site.driver.missing = {}
    site.driver.one_tree = False
    site.again()
    site.step()
    assert "driver memory shapes each link by itself" in site.ask("show").notes[0]


def test_a_cell_that_is_nobodys_any_more_is_left_for_links_of_their_own(tmp_path: Path) -> None:
    site = Site(tmp_path, cell=("R1", "R2"))
    site.ask(rate_bps=8_000_000)
    site.step()
    site.cell = ()
    site.again()
    site.step()
    assert {shape.capacity_bps for shape in site.driver.shapes.values()} == {8_000_000}
    assert all(not shape.cell_bps for shape in site.driver.shapes.values())
