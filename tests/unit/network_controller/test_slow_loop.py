"""When the slow loop moves bandwidth, and when it leaves it."""

from __future__ import annotations

import math

from network_controller import ladder
from network_controller.model import Link
from network_controller.slow_loop import DEMAND_FRESH_S, Action, Load, SlowLoop
from swarm.messages import NetDemand

CELL = Link("R1", "down")
FLOODED = Load(capacity_bps=3_000_000, control_bps=300_000, background_bps=math.inf)
IDLE = Load(capacity_bps=3_000_000, control_bps=300_000, background_bps=0.0)


def demand(needed_bps: int, unreachable_s: float = 1.0, ego: str = "R1") -> NetDemand:
    return NetDemand(
        ego=ego,
        cycle=1,
        sent_ns=0,
        needed_bytes_s=needed_bps // 8,
        possible=True,
        reachable=unreachable_s == 0.0,
        unreachable_s=unreachable_s,
        quality=0.5,
        q_min=0.9,
        capacity_bps=1_000_000,
    )


class Run:
    """A loop that is driven second by second."""

    def __init__(self, loop: SlowLoop | None = None) -> None:
        self.loop = loop or SlowLoop()
        self.now_s = 0.0

    def __call__(
        self, seconds: int, load: Load, wants: NetDemand | None, link: Link = CELL
    ) -> list[Action]:
        taken = []
        for _ in range(seconds):
            self.now_s += 1.0
            if wants is not None:
                self.loop.on_demand(wants, self.now_s)
            for action in self.loop.tick({link: load}, self.now_s):
                self.loop.done(action)
                taken.append(action)
        return taken


def test_a_shortfall_that_lasts_for_three_windows_is_one_step() -> None:
    run = Run()
    assert run(15, FLOODED, demand(1_900_000)) == []
    (action,) = run(1, FLOODED, demand(1_900_000))
    assert (action.before, action.after) == (0, 1)
    assert "R1 needs 1.90 Mbit/s" in action.reason
    # One step was enough: 1.95 Mbit/s are there now.
    assert run(60, FLOODED, demand(1_900_000, unreachable_s=0.0)) == []


def test_a_shortfall_that_pauses_starts_to_count_again() -> None:
    run = Run()
    for _ in range(10):
        assert run(12, FLOODED, demand(1_900_000)) == []
        assert run(1, IDLE, demand(1_900_000, unreachable_s=0.0)) == []


def test_steps_go_on_while_the_shortfall_does_and_end_at_the_top() -> None:
    run = Run()
    actions = run(200, FLOODED, demand(9_000_000))
    assert [action.after for action in actions] == [1, 2, 3]
    assert run.loop.level(CELL) == ladder.TOP


def test_an_ego_that_the_link_does_not_keep_from_q_min_moves_nothing() -> None:
    assert Run()(100, FLOODED, demand(9_000_000, unreachable_s=0.0)) == []


def test_a_need_that_the_link_meets_moves_nothing() -> None:
    """The ego may say that it lacks something while it still measures an old rate."""
    assert Run()(100, FLOODED, demand(1_000_000, unreachable_s=50.0)) == []


def raised(level: int) -> Run:
    run = Run()
    run.loop.levels[CELL] = level
    return run


def test_bandwidth_is_given_back_step_by_step_when_telemetry_has_ended() -> None:
    actions = raised(2)(60, IDLE, demand(1_900_000, unreachable_s=0.0))
    assert [(a.before, a.after) for a in actions] == [(2, 1), (1, 0)]


def test_bandwidth_is_given_back_when_the_ego_has_left() -> None:
    run = raised(1)
    run(1, FLOODED, demand(1_900_000))
    actions = run(math.ceil(DEMAND_FRESH_S) + 20, FLOODED, None)
    assert [a.after for a in actions] == [0]
    assert "nobody" in actions[0].reason


def test_what_is_still_needed_is_kept() -> None:
    assert raised(1)(200, FLOODED, demand(1_900_000, unreachable_s=0.0)) == []


def test_a_need_just_below_what_the_lower_level_gives_is_within_the_hysteresis() -> None:
    gives = ladder.available_bps(3_000_000, 0, 300_000, math.inf)
    assert raised(1)(100, FLOODED, demand(round(0.95 * gives), unreachable_s=0.0)) == []
    assert raised(1)(100, FLOODED, demand(round(0.85 * gives), unreachable_s=0.0)) != []


def test_a_load_that_comes_and_goes_every_few_seconds_moves_nothing() -> None:
    run = raised(1)
    for _ in range(30):
        assert run(3, IDLE, demand(1_900_000, unreachable_s=0.0)) == []
        assert run(3, FLOODED, demand(1_900_000, unreachable_s=0.0)) == []


def test_each_ego_moves_its_own_cell_only() -> None:
    run = Run()
    other = Link("R2", "down")
    for _ in range(30):
        run.now_s += 1.0
        run.loop.on_demand(demand(1_900_000), run.now_s)
        run.loop.on_demand(demand(100_000, 0.0, ego="R2"), run.now_s)
        for action in run.loop.tick({CELL: FLOODED, other: FLOODED}, run.now_s):
            run.loop.done(action)
    assert run.loop.levels == {CELL: 1}


def test_a_link_that_is_made_anew_starts_at_level_0() -> None:
    run = raised(2)
    run.loop.forget(CELL)
    assert run.loop.level(CELL) == 0


def test_links_from_robots_are_left_alone() -> None:
    assert Run()(60, FLOODED, demand(1_900_000), Link("R1", "up")) == []
