"""How a control window is played: what is in time, and why the rest is not, counted by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from ego_agent.knowledge.compute import Work
from perception import metrics
from perception.metrics import Match
from research.evaluation.windows.cell import Cell
from research.evaluation.windows.played import play
from research.evaluation.windows.precision import precision_of, shares
from research.evaluation.windows.timing import Conditions, Played
from research.evaluation.windows.traffic import HEADERS, left_bps

FAST_BPS = 1e12
QUICK = Work(encode_ms=10, fixed_ms=1, add_ms=0)


def always(bps: float) -> Callable[[float], float]:
    return lambda _: bps


def played(
    robots: tuple[str, ...], frames: int, size: int, conditions: Conditions
) -> tuple[Played, list[str]]:
    """The window, and for each frame `in`, or why the first robot is not."""
    window = play(robots, frames, lambda *_: size, conditions)
    return window, [
        "skipped" if one is None else one.missing.get(robots[0], "in") for one in window.frames
    ]


def test_a_frame_takes_encoding_the_link_and_fusing() -> None:
    work = Work(encode_ms=10, fixed_ms=20, add_ms=2)
    # 10 kB take 10 ms of 8 Mbit/s; the second waits for the first.
    window, _ = played(("R2", "R3"), 50, 10_000, Conditions(work, always(8e6)))
    assert [one.in_time for one in window.fused()] == [("R2", "R3")] * 50
    assert {round(one.latency_s, 6) for one in window.fused()} == {0.010 + 0.020 + 0.024}
    assert window.sent_bytes == 50 * 2 * 10_000


def test_of_a_link_that_carries_half_late_answers_take_their_part() -> None:
    # Each answer takes the link 200 ms, ten are due a second.
    window, why = played(("R2",), 20, 10_000, Conditions(QUICK, always(400e3)))
    second = ["in", "busy", "busy", "in", "deadline", "busy", "deadline", "busy", "busy", "busy"]
    assert why == second * 2
    assert window.sent_bytes == 2 * 4 * 10_000


def test_a_robot_that_encodes_longer_than_a_frame_is_busy() -> None:
    work = Work(encode_ms=160, fixed_ms=1, add_ms=0)
    _, why = played(("R2",), 10, 1_000, Conditions(work, always(FAST_BPS)))
    assert why[:6] == ["in", "busy", "in", "in", "deadline", "busy"]
    assert why[6:] == ["in", "busy", "busy", "in"]


def test_what_misses_the_deadline_is_carried_all_the_same() -> None:
    # 300 ms on the link: every fourth frame is asked for, and nothing is in time.
    window, why = played(("R2",), 8, 30_000, Conditions(QUICK, always(800e3)))
    assert why == ["deadline", "busy", "busy", "busy"] * 2
    assert window.fused()[0].latency_s == pytest.approx(0.25 + 0.001)
    assert window.sent_bytes == 2 * 30_000


def test_an_answer_that_would_take_the_link_a_second_is_refused() -> None:
    window, why = played(("R2",), 5, 101_000, Conditions(QUICK, always(800e3)))
    assert why == ["refused"] * 5
    assert window.sent_bytes == 0
    small, why = played(("R2",), 1, 2_000, Conditions(QUICK, always(8e3)))
    assert why == ["deadline"], "boxes may always be sent"
    assert small.sent_bytes == 2_000


def test_robots_and_ego_may_share_processors() -> None:
    work = Work(encode_ms=10, fixed_ms=20, add_ms=2)
    for processors, expected_s in ((None, 0.010 + 0.024), (2, 0.010 + 0.024), (1, 0.020 + 0.024)):
        conditions = Conditions(work, always(FAST_BPS), processors=processors)
        window, _ = played(("R2", "R3"), 1, 1_000, conditions)
        assert window.fused()[0].latency_s == pytest.approx(expected_s, abs=1e-6)
    # 84 ms of work a frame for one processor: it keeps up; with 124 it cannot.
    for fixed_ms, keeps_up in ((40, True), (80, False)):
        work = Work(encode_ms=20, fixed_ms=fixed_ms, add_ms=2)
        window, _ = played(
            ("R2", "R3"), 50, 1_000, Conditions(work, always(FAST_BPS), processors=1)
        )
        complete = sum(len(one.in_time) == 2 for one in window.fused())
        assert (complete == 50) is keeps_up


def test_a_robot_may_have_a_narrower_link_of_its_own() -> None:
    conditions = Conditions(QUICK, always(8e6), {"R2": 800e3})
    window, _ = played(("R2", "R3"), 1, 10_000, conditions)
    # R2: 100 ms on its own link and 10 ms on the cell.
    assert window.fused()[0].latency_s == pytest.approx(0.010 + 0.100 + 0.010 + 0.001)
    window, why = played(("R2", "R3"), 1, 25_000, conditions)
    assert why == ["deadline"]
    assert window.fused()[0].in_time == ("R3",)


def test_frames_that_the_ego_has_no_time_for_are_skipped() -> None:
    work = Work(encode_ms=0, fixed_ms=250, add_ms=0)
    window = play((), 50, lambda *_: 0, Conditions(work, always(FAST_BPS)))
    # 20 in five seconds, and those under way at the end.
    assert 20 <= len(window.fused()) <= 24
    skipped = window.frames.index(None)
    following = next(one for one in window.fused() if one.number > skipped)
    assert window.shown_from(skipped) is following
    assert window.shown_from(50) is window.fused()[-1]


def test_a_window_repeats_itself() -> None:
    conditions = Conditions(QUICK, lambda at_s: 1e6 + 5e5 * math.sin(at_s), processors=2)
    robots = ("R2", "R3", "R4", "R5")
    first, again = (play(robots, 50, lambda *_: 5_000, conditions) for _ in range(2))
    assert first == again
    assert {robot for one in first.fused() for robot in one.missing} <= set(robots)


def test_a_link_whose_rate_changes_while_it_carries() -> None:
    cell = Cell(lambda at_s: 1e6 if at_s < 0.999 else 5e5)
    assert cell.send(0.5, 125_000) == pytest.approx(2.0)
    assert cell.send(1.0, 62_500) == pytest.approx(3.0), "one after the other"
    assert cell.send(10.0, 62_500) == pytest.approx(11.0)
    assert Cell(always(1.0)).send(0.0, 1_000) == math.inf


def test_frames_that_count_alike_have_the_usual_precision() -> None:
    rng = np.random.default_rng(1)
    frames = [Match(-np.sort(-rng.random(9)), rng.random(9) < 0.6, 7) for _ in range(3)]
    assert precision_of([(one, 1.0) for one in frames]) == metrics.precision_of(frames)
    twice = [frames[0], frames[0], frames[1]]
    uneven = precision_of([(frames[0], 2), (frames[1], 1)])
    assert uneven == pytest.approx(metrics.precision_of(twice))
    assert precision_of([]) == 0.0


def test_shares_of_what_comes_more_than_once() -> None:
    assert shares(["a", "a", "b", "a"]) == {"a": 0.75, "b": 0.25}


def test_control_traffic_goes_first() -> None:
    assert left_bps(1.044e6, 0.0) == pytest.approx(1e6)
    assert left_bps(1e6, 1e5) == pytest.approx(1e6 / HEADERS - 1e5)
    assert left_bps(1e4, 1e5) == 1.0
