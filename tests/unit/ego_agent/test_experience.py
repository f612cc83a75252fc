"""What answers teach: how long each robot takes, and how soon that is forgotten."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.answers import AnswerTimes
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.experience import (
    DRAIN_MOST_S,
    DRAIN_S,
    MAX_SERIES,
    Experience,
    frames_of,
)
from ego_agent.knowledge.learnt import HALF_LIFE_S
from ego_agent.knowledge.own_costs import KNOWN_S, OwnCosts
from ego_agent.knowledge.series import MEMORY_FRAMES
from tests.support.ego_scenes import snapshot, view

DEADLINE_S = 0.25


class Steady:
    """A clock that goes when it is told to."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def told(
    robots: Iterable[str], algorithm: str, answer_s: float, *, times: int = 20
) -> list[tuple[str, str, float]]:
    return [(robot, algorithm, answer_s) for _ in range(times) for robot in robots]


def experience(*stories: list[tuple[str, str, float]]) -> tuple[Experience, Steady]:
    clock = Steady()
    known = Experience(clock)
    for story in stories:
        for robot, algorithm, answer_s in story:
            known.record(robot, algorithm, answer_s)
    return known, clock


def in_time(known: Experience, robot: str, algorithm: str) -> float:
    answers = known.learnt().of(robot, [algorithm]).get(algorithm, AnswerTimes())
    return answers.in_time(DEADLINE_S)


def late_cycle(known: Experience, clock: Steady, *, standing: bool) -> float:
    """A second on 60 kbit/s in which a request of R1 is late; what is believed of it then."""
    asked_s, clock.now_s = clock.now_s, clock.now_s + 1.0
    known.record("R1", "late", 0.6, asked_s=asked_s, deadline_s=DEADLINE_S, capacity_bps=6e4)
    known.look(6e4, standing=standing)
    return in_time(known, "R1", "late")


def test_who_was_never_asked_is_taken_to_be_in_time() -> None:
    known, _ = experience()
    assert in_time(known, "R1", "late") == 1.0
    assert known.learnt().of("R1", ["late"]) == {}


def test_answers_that_all_came_in_time_leave_no_doubt() -> None:
    known, _ = experience(told(["R1", "R2"], "late", 0.1))
    assert in_time(known, "R1", "late") == 1.0


def test_two_seconds_of_late_answers_undo_any_number_of_timely_ones() -> None:
    known, _ = experience(told(["R1"], "late", 0.1, times=500), told(["R1"], "late", 0.4))
    assert in_time(known, "R1", "late") < 0.05
    assert known.learnt().of("R1", ["late"])["late"].in_time(0.5) == 1.0


def test_an_answer_counts_for_all_frames_that_waited_for_it() -> None:
    known, _ = experience(told(["R1"], "late", 0.1))
    known.record("R1", "late", math.inf, frames=15.0)
    assert in_time(known, "R1", "late") == pytest.approx(0.25, abs=0.1)
    assert known.learnt().of("R1", ["late"])["late"].lost == pytest.approx(0.75)


def test_a_missed_deadline_says_nothing_about_a_longer_one() -> None:
    known, _ = experience(told(["R1"], "late", 0.1))
    for _ in range(20):
        known.record("R1", "late", 0.251, at_least=True)
    answers = known.learnt().of("R1", ["late"])["late"]
    assert answers.in_time(DEADLINE_S) < 0.1
    assert answers.in_time(0.5) == 1.0
    for _ in range(5):
        known.record("R1", "late", 0.8)
    assert known.learnt().of("R1", ["late"])["late"].in_time(0.5) < 0.15
    assert known.learnt().of("R2", ["late"])["late"].in_time(0.5) < 0.4


@pytest.mark.parametrize(("rate_hz", "least_s", "most_s"), [(10, 2, 2), (2.5, 2, 2), (1, 5, 5)])
def test_two_to_five_seconds_are_remembered_at_any_rate(
    rate_hz: float, least_s: float, most_s: float
) -> None:
    remembered_s = MEMORY_FRAMES / frames_of(0.1, rate_hz, 10.0) / rate_hz
    assert least_s <= remembered_s <= most_s


def test_what_five_robots_have_taught_need_not_be_found_out_by_the_sixth() -> None:
    five = ["R1", "R2", "R3", "R4", "R5"]
    known, _ = experience(told(five, "late", 0.4), told(five, "early", 0.1))
    assert in_time(known, "R6", "late") < 0.25
    assert in_time(known, "R6", "early") == 1.0


def test_a_slow_robot_is_expected_to_be_slow_with_what_it_was_never_asked_for() -> None:
    others = ["R1", "R2", "R3", "R4"]
    known, _ = experience(
        told([*others, "R9"], "early", 0.05), told(others, "late", 0.1), told(["R5"], "early", 0.5)
    )
    assert in_time(known, "R9", "late") == 1.0
    assert in_time(known, "R5", "late") < 0.25


def test_one_robot_ten_times_slower_than_the_others_takes_nothing_from_their_credit() -> None:
    others = ["R1", "R2", "R3", "R4", "R5"]
    known, _ = experience(told(others, "late", 0.05), told(["R6"], "late", 0.5))
    assert in_time(known, "R6", "late") < 0.15
    assert all(in_time(known, robot, "late") == 1.0 for robot in others)
    assert in_time(known, "R7", "late") == 1.0


def test_what_is_not_seen_again_is_half_forgotten_after_its_half_life() -> None:
    known, clock = experience(told(["R1"], "late", math.inf))
    before = known.learnt().of("R1", ["late"])["late"].frames
    clock.now_s += HALF_LIFE_S
    assert known.learnt().of("R1", ["late"])["late"].frames == pytest.approx(before / 2)
    clock.now_s += 10 * HALF_LIFE_S
    assert in_time(known, "R1", "late") > 0.9


@pytest.mark.parametrize("answer_s", [math.inf, 0.4])
def test_what_was_late_says_nothing_of_a_link_that_is_several_times_wider(answer_s: float) -> None:
    known, _ = experience()
    for _ in range(20):
        known.record("R1", "late", answer_s, capacity_bps=1e6, deadline_s=DEADLINE_S)
    chances = {bps: chance_over(known, bps) for bps in (1e5, 1e6, 2e6, 3e6, 4e6, 55e6)}
    assert chances[1e5] == chances[1e6] == chances[2e6] < 0.05
    assert chances[2e6] < chances[3e6] < chances[4e6] == chances[55e6] == 1.0
    assert known.learnt(55e6).of("R1", ["late"])["late"].lost == 0.0


def test_what_was_in_time_says_little_of_a_link_that_is_several_times_narrower() -> None:
    known, _ = experience()
    for _ in range(10):
        known.record("R1", "late", 0.1, capacity_bps=20e6, deadline_s=DEADLINE_S)
    for _ in range(10):
        known.record("R1", "late", 0.4, capacity_bps=1e6, deadline_s=DEADLINE_S)
    chances = [chance_over(known, bps) for bps in (1e6, 2e6, 10e6, 20e6, 100e6)]
    assert chances == sorted(chances)
    assert chances[0] < 0.2
    assert chances[-1] == 1.0


def chance_over(known: Experience, capacity_bps: float) -> float:
    return known.learnt(capacity_bps).of("R1", ["late"])["late"].in_time(DEADLINE_S)


def test_what_was_late_while_a_link_became_narrower_is_held_against_nobody() -> None:
    known, clock = experience()

    def ask(answer_s: float, capacity_bps: float) -> None:
        asked_s, clock.now_s = clock.now_s, clock.now_s + min(answer_s, 0.3)
        known.record(
            "R1",
            "early",
            answer_s,
            capacity_bps=capacity_bps,
            at_least=answer_s == 0.3,
            asked_s=asked_s,
            deadline_s=DEADLINE_S,
        )

    known.look(20e6)
    for answer_s in (0.1, 0.3, 0.3, math.inf):
        ask(answer_s, 20e6)
    assert in_time(known, "R1", "early") < 0.4
    known.look(1e6)
    assert in_time(known, "R1", "early") == 1.0
    ask(0.4, 20e6)  # Asked before the decision changed, or behind what was.
    assert in_time(known, "R1", "early") == 1.0
    clock.now_s += DRAIN_S
    for _ in range(5):
        ask(0.4, 1e6)
    assert in_time(known, "R1", "early") < 0.3


def test_what_is_late_while_beacons_still_stand_is_held_against_nobody() -> None:
    known, clock = experience()
    known.look(1e6)
    known.look(6e4)
    assert [late_cycle(known, clock, standing=True) for _ in range(4)] == [1.0] * 4
    late_cycle(known, clock, standing=False)
    assert late_cycle(known, clock, standing=False) == 1.0  # The queue was emptying.
    assert late_cycle(known, clock, standing=False) < 0.9
    assert late_cycle(known, clock, standing=True) < 0.9, "a queue that fills anew is another one"


def test_a_queue_that_stands_on_is_what_is_asked_now() -> None:
    known, clock = experience()
    known.look(1e6)
    known.look(6e4)
    for _ in range(round(DRAIN_MOST_S) + 5):
        believed = late_cycle(known, clock, standing=True)
    assert believed < 0.5


def test_a_guess_that_rises_does_not_make_up_for_what_was_late() -> None:
    known, _ = experience()
    for _ in range(20):
        known.record("R1", "late", 0.4, capacity_bps=1e6, deadline_s=DEADLINE_S)
    guessed = known.learnt(4e6, configured=False).of("R1", ["late"])["late"]
    assert guessed.in_time(DEADLINE_S) < 0.1
    known.look(None)
    known.look(1e5)
    known.look(None)
    assert in_time(known, "R1", "late") < 0.05


def test_what_was_late_on_a_link_that_wavers_stays() -> None:
    known, _ = experience(told(["R1"], "early", math.inf))
    for capacity_bps in (20e6, 11e6, 20e6, 10e6):
        known.look(capacity_bps)
    assert in_time(known, "R1", "early") < 0.05


def test_a_clock_that_jumps_teaches_nothing() -> None:
    known = Knowledge(algorithms=["late"])
    for _ in range(20):
        known.experience.record("A", "late", 0.1, capacity_bps=20e6)
    found = []
    for jump_s in (0.0, 86_400.0, -86_400.0):
        shot = snapshot(view("E"), view("A", 5))
        moved = type(shot)(
            ego=shot.ego,
            cycle=shot.cycle,
            now_ns=shot.now_ns + round(jump_s * 1e9),
            robots=shot.robots,
            capacity_bps=shot.capacity_bps,
            capacity_source=shot.capacity_source,
        )
        answers = analyze(moved, known).candidates[0].answers["late"]
        found.append((round(answers.frames), answers.in_time(DEADLINE_S), answers.answer_s))
    assert found == [(20, 1.0, 0.1)] * 3


def test_encoding_is_told_apart_from_the_way() -> None:
    known, _ = experience()
    for _ in range(3):
        known.record("R1", "early", 0.2, encode_s=0.05)
    answers = known.learnt().of("R1", ["early"])["early"]
    assert (answers.encode_s, answers.answer_s) == (0.05, 0.2)
    assert answers.transfer_s == pytest.approx(0.15)


def test_what_is_remembered_is_bounded() -> None:
    known, _ = experience()
    for number in range(MAX_SERIES + 1):
        known.record(f"R{number}", "late", 0.1)
    assert known.last("R0", "late") is None
    assert known.last(f"R{MAX_SERIES}", "late") is not None


def test_an_ego_that_must_not_learn_heeds_nothing() -> None:
    known = Knowledge(algorithms=["late"], learns=False)
    for _ in range(20):
        known.experience.record("A", "late", math.inf)
    assert analyze(snapshot(view("E"), view("A", 5)), known).candidates[0].answers == {}


def test_what_a_frame_takes_the_ego_grows_with_those_who_take_part() -> None:
    costs = OwnCosts()
    assert costs.frame_s("early", 5) == 0.0
    assert costs.work_s("early") is None
    costs.record("early", 5, 0.05, 0.02, 0.005)
    assert costs.frame_s("early", 5) == pytest.approx(0.07)
    assert costs.work_s("early") == pytest.approx(0.001), "of a processor, not of the clock"
    for _ in range(3):
        costs.record("early", 5, 0.05, 0.02, 0.02)
    assert costs.work_s("early") == pytest.approx(0.001), "what else runs only makes it longer"
    assert costs.add_s("early") == pytest.approx(0.004), "by the clock"
    assert costs.frame_s("early", 0) == pytest.approx(0.05)
    assert costs.frame_s("late", 5) == 0.0


def test_what_a_busy_machine_took_is_forgotten_when_nothing_is_fused_with_it() -> None:
    now_s = 100.0
    costs = OwnCosts(lambda: now_s)
    for _ in range(10):
        costs.record("early", 5, 0.3, 0.1, 0.1)
    now_s += KNOWN_S
    assert costs.frame_s("early", 0) == pytest.approx(0.3)
    now_s += 1.0
    assert costs.frame_s("early", 0) == 0.0
    assert (costs.add_s("early"), costs.work_s("early")) == (None, None)
    costs.record("early", 5, 0.03, 0.01, 0.01)
    assert costs.frame_s("early", 0) == pytest.approx(0.03)


def test_what_contributions_took_is_forgotten_also_while_frames_have_none() -> None:
    now_s = 100.0
    costs = OwnCosts(lambda: now_s)
    costs.record("early", 5, 0.3, 0.5, 0.5)
    for _ in range(40):
        now_s += 1.0
        costs.record("early", 0, 0.02, 0.0, 0.0)
    assert (costs.add_s("early"), costs.work_s("early")) == (None, None)
    assert costs.frame_s("early", 5) == pytest.approx(0.02)
