"""What egos say of how a robot fits stands in its own log, once; so does that none is heard."""

from __future__ import annotations

import msgspec
import pytest
import structlog.testing

from robot_agent.fit import AGAIN_S, MOVED_WORDS, UNHEARD_S, Fit
from swarm.messages import NetDemand
from swarm.tcp.stuck import LOOK_S
from tests.support.message_samples import SAMPLES

MARK = "factory seed=1"
DEMAND = msgspec.structs.replace(
    next(sample for sample in SAMPLES if isinstance(sample, NetDemand)),
    ego="R2",
    world=MARK,
    told={},
)


class Robot:
    """R1 and R2 of one process, on a clock of the test's own."""

    def __init__(self, mark: str = MARK) -> None:
        self.now_s = 100.0
        self.moved: list[str] = []
        self.stuck = ""
        log = structlog.wrap_logger(structlog.PrintLogger())
        self.fit = Fit(
            ("R1", "R2"),
            mark,
            "swarm 'local' at tcp/h:1",
            log,
            self.moved.append,
            lambda: self.now_s,
            lambda: self.stuck,
        )

    def hears(self, **changes: object) -> list[tuple[str, str]]:
        with structlog.testing.capture_logs() as lines:
            self.fit.on_demand(msgspec.structs.replace(DEMAND, **changes))
        return [(line["log_level"], line.get("why", "")) for line in lines]

    def looks(self) -> list[str]:
        with structlog.testing.capture_logs() as lines:
            self.fit.look()
        return [line["why"] for line in lines]


def test_what_an_ego_tells_is_logged_once_and_so_is_its_end() -> None:
    robot = Robot()
    assert robot.hears() == []
    told = {"R1": "two processes use its id", "R9": "somebody else"}
    assert robot.hears(told=told) == [("warning", "R1: two processes use its id")]
    assert robot.hears(told=told) == []
    assert robot.hears() == [("info", "R1 fits again")]


def test_a_robot_sees_by_itself_that_the_ego_lives_elsewhere() -> None:
    robot = Robot("factory seed=2")
    why = "R1: it lives in another world: seed 2 (the ego's: 1)"
    assert robot.hears() == [("warning", why)]
    # The ego's own robot is the ego's business.
    assert robot.hears() == []


def test_an_ego_that_lives_elsewhere_for_a_while_has_moved() -> None:
    robot = Robot()
    robot.hears(world="factory seed=2")
    robot.hears(world="factory seed=2")
    robot.hears()
    assert robot.moved == []
    for _ in range(MOVED_WORDS + 2):
        robot.hears(world="factory seed=2")
    (why,) = robot.moved
    assert why.startswith("ego R2 was started anew: it lives in another world")


def test_a_robot_that_hears_no_ego_says_so_now_and_then() -> None:
    robot = Robot()
    assert robot.looks() == []
    robot.now_s += UNHEARD_S
    (why,) = robot.looks()
    assert why == "no ego is heard in swarm 'local' at tcp/h:1: the swarm may have another name"
    assert robot.looks() == []
    robot.now_s += AGAIN_S
    assert len(robot.looks()) == 1
    assert robot.hears() == [("info", "")]
    assert robot.looks() == []


@pytest.mark.parametrize("count", [300])
def test_many_egos_cost_no_more_than_so_many_lines(count: int) -> None:
    robot = Robot("factory seed=2")
    said = [robot.hears(ego=f"E{i}") for i in range(count)]
    assert sum(map(len, said)) <= 256


def test_a_way_that_takes_no_full_packets_is_told_now_and_then() -> None:
    robot = Robot()
    robot.hears()
    robot.now_s += LOOK_S
    assert robot.looks() == []
    robot.stuck = "packets of 1448 bytes do not get through"
    robot.now_s += LOOK_S
    robot.hears()
    assert robot.looks() == [robot.stuck]
    robot.now_s += LOOK_S
    assert robot.looks() == []
