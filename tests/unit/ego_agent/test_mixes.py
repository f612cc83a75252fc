"""Who sends what, and how often: one algorithm is what it was, budgets hold, the best is found."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ego_agent.analyze.scene_file import read_scene
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.compute import Work
from ego_agent.knowledge.journal import CycleRecord
from ego_agent.knowledge.model import OBJECTS_PART, PART, Proposal, UnifiedScene, Weights
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import EVERYTHING, RARER_HZ, about_places, in_turn, of_objects
from ego_agent.knowledge.record import cycle_record
from ego_agent.knowledge.tally import Tally
from ego_agent.plan.choices.explain import explain
from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.hysteresis import best_option, held, still_possible
from ego_agent.plan.choices.mixes import Mixes, burst
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.validation import Unusable, validate
from ego_agent.plan.decision import plan
from ego_agent.plan.demand import ROUNDING, DemandMeter, need
from ego_agent.plan.policies.coverage import Coverage
from swarm.messages import ALGORITHMS, MIXED, Assignment, Decision
from tests.support.ego_scenes import BOTH, NOW_NS, candidate, scene, snapshot, view

EXAMPLE = Path(__file__).parents[3] / "docs" / "example-scene.json"
SIZES = {"early": 3_000, "intermediate": 40_000, "late": 500}


def knowing(algorithms: tuple[str, ...] = BOTH, **objective: Any) -> Knowledge:
    wanted = Objective(**{"q_min": 0.7, "rarer_hz": RARER_HZ, **objective})
    return Knowledge.of_detector("factory", wanted, algorithms)


def a_floor(seed: int, robots: int = 6, capacity_bps: float = 20e6) -> UnifiedScene:
    """Robots that see overlapping parts of 64 cells and of four objects."""
    rng = np.random.default_rng(seed)

    def seen() -> dict[str, Any]:
        first, count = int(rng.integers(0, 50)), int(rng.integers(5, 30))
        return {
            "cells": range(first, min(64, first + count)),
            "evidence": (rng.random(4) * (rng.random(4) < 0.5)).tolist(),
            "sizes": {name: int(size * rng.uniform(0.5, 2.0)) for name, size in SIZES.items()},
        }

    others = [candidate(f"R{i}", **seen(), distance_m=float(i)) for i in range(2, 2 + robots)]
    return scene(candidate("R1", **seen()), *others, capacity_bps=capacity_bps)


def decide(found: UnifiedScene, known: Knowledge, previous: Decision | None = None) -> Decision:
    return plan(snapshot(ego="R1"), found, Coverage(), known, previous, 7, NOW_NS)


def assignments(*wanted: tuple[str, str, float]) -> tuple[Assignment, ...]:
    return tuple(Assignment(robot=r, algorithm=a, rate_hz=hz) for r, a, hz in wanted)


def weighed(found: UnifiedScene, seed: int) -> UnifiedScene:
    """The scene with places and objects that count more, and less."""
    rng = np.random.default_rng(seed)
    cells = rng.choice([0.25, 1.0, 4.0], found.ego.area.shape).astype(np.float32)
    objects = rng.choice([0.25, 1.0, 4.0], len(found.objects)).astype(np.float32)
    return replace(found, weights=Weights(cells, objects))


@pytest.mark.parametrize("counts_alike", [True, False])
@pytest.mark.parametrize("algorithm", BOTH)
@pytest.mark.parametrize("seed", range(8))
def test_one_algorithm_in_every_frame_is_what_the_scorer_says(
    seed: int, algorithm: str, counts_alike: bool
) -> None:
    floor = a_floor(seed)
    scorer = Scorer(floor if counts_alike else weighed(floor, seed), knowing())
    mixes = Mixes(scorer)
    for count in range(1, 6):
        robots = [c.robot for c in scorer.scene.candidates[:count]]
        expected = scorer.score(robots, algorithm)
        found = mixes.score(assignments(*((robot, algorithm, 10.0) for robot in robots)))
        assert found == expected
        # And so it counts on the way: less only by steps of evidence.
        growing = mixes._nobody()
        for i in range(count):
            option = mixes.option(algorithm, 10.0)
            assert option is not None
            mixes._take(growing, i, option)
        assert mixes._quality(growing) == pytest.approx(expected.quality, abs=0.02)


def best_of_all(mixes: Mixes) -> Score:
    """By trying everything."""
    robots = [c.robot for c in mixes.scorer.scene.candidates]
    choices = [[None, *mixes.options_of(robot)] for robot in robots]
    scores = [mixes.score([one for one in some if one]) for some in itertools.product(*choices)]
    able = [s for s in scores if s is not None and mixes.carries(s)]
    good = [s for s in able if mixes.scorer.good_enough(s)]
    return max(good, key=lambda s: s.value) if good else max(able, key=lambda s: s.quality)


@pytest.mark.parametrize("capacity_bps", [2e5, 1e6, 20e6])
def test_the_greedy_orders_are_nearly_as_good_as_trying_everything(capacity_bps: float) -> None:
    missed = []
    for seed in range(12):
        found = a_floor(seed, robots=3, capacity_bps=capacity_bps)
        mixes = Mixes(Scorer(found, knowing(rarer_hz=(5.0, 2.0))))
        grown = [mixes.grow(by_byte=by_byte) for by_byte in (True, False)]
        assert all(mixes.carries(score) for score in grown)
        best, ours = best_of_all(mixes), best_option(mixes.scorer, grown)
        assert mixes.scorer.good_enough(ours) or not mixes.scorer.good_enough(best)
        what = "value" if mixes.scorer.good_enough(best) else "quality"
        missed.append(getattr(best, what) - getattr(ours, what))
    assert max(missed) <= 0.05
    assert np.mean(missed) <= 0.01


@pytest.mark.parametrize("seed", range(6))
def test_on_a_narrow_link_robots_send_less_and_less_often(seed: int) -> None:
    known = knowing()
    wide, narrow = (decide(a_floor(seed, capacity_bps=bps), known) for bps in (20e6, 2e5))
    assert wide.cost_bytes >= narrow.cost_bytes
    assert narrow.cost_bytes * 8 * narrow.rate_hz <= 0.8 * 2e5
    scorer = Scorer(a_floor(seed, capacity_bps=2e5), known)
    uniform = [
        score
        for algorithm in BOTH
        for score in grow(scorer, scorer.scene.candidates, algorithm, by_byte=True)
    ]
    chosen = Mixes(scorer).score(narrow.assignments)
    assert chosen is not None
    good = [score.value for score in uniform if scorer.good_enough(score)]
    assert not good or chosen.value >= max(good) - 1e-9


def test_the_near_send_points_and_the_far_boxes_where_all_points_do_not_fit() -> None:
    found = scene(
        candidate("R1", range(10), sizes=SIZES),
        candidate("R2", range(10, 45), sizes=SIZES),
        candidate("R3", range(45, 64), sizes={**SIZES, "early": 60_000}),
        capacity_bps=8e5,
    )
    decision = decide(found, knowing(lambda_compute=0.0))
    forms = {one.robot: one.algorithm for one in decision.assignments}
    assert forms == {"R2": "early", "R3": "late"}
    assert decision.algorithm == MIXED
    assert decision.participants == ("R1", "R2", "R3")
    assert "mixed (1 early, 1 late)" in decision.reason
    told = {one["robot"]: one["why"] for one in explain(found, knowing(), decision)["candidates"]}
    assert told["R2"].startswith("in: early")
    assert told["R3"].startswith("in: late")


def test_a_decision_in_force_stays_while_the_link_wavers() -> None:
    known = knowing()
    decision = decide(a_floor(3, capacity_bps=1e6), known)
    first = decision.assignments
    assert first
    for capacity_bps in (1.01e6, 0.99e6, 1.02e6, 0.98e6):
        decision = decide(a_floor(3, capacity_bps=capacity_bps), known, decision)
        assert decision.assignments == first


def test_who_leaves_is_missing_and_the_others_go_on() -> None:
    found, known = a_floor(3, capacity_bps=1e6), knowing()
    decision = decide(found, known)
    gone = decision.participants[-1]
    left = tuple(c for c in found.candidates if c.robot != gone)
    after = decide(replace(found, candidates=left), known, decision)
    assert gone not in after.participants
    assert {one.robot for one in after.assignments} <= {c.robot for c in left}


names = st.sampled_from(["R1", "R2", "R3", "R4", "R9", "", "R2"])
wishes = st.lists(
    st.builds(
        Assignment,
        robot=names,
        algorithm=st.sampled_from([*ALGORITHMS, MIXED, "nothing"]),
        rate_hz=st.sampled_from([10.0, 5.0, 3.0, 2.0, 0.5, 0.1, 100.0]),
    ),
    max_size=6,
)


@settings(max_examples=150, deadline=None)
@given(wishes, st.integers(0, 20), st.sampled_from([1e3, 1e5, 1e6, 20e6]), st.lists(names))
def test_whatever_is_assigned_what_is_decided_fits(
    wanted: list[Assignment], seed: int, capacity_bps: float, who: list[str]
) -> None:
    found, known = a_floor(seed, robots=3, capacity_bps=capacity_bps), knowing()
    proposal = Proposal(tuple(who), MIXED, "", "policy", assignments=tuple(wanted))
    decision = validate(proposal, found, known, policy="test", cycle=1, now_ns=NOW_NS)
    if isinstance(decision, Unusable):
        return
    sizes = {c.robot: c.sizes for c in found.candidates}
    others = decision.participants[1:]
    sent = {one.robot: (one.algorithm, one.rate_hz) for one in decision.assignments}
    sent = sent or dict.fromkeys(others, (decision.algorithm, decision.rate_hz))
    assert [*sent] == [*others]
    bits = sum(8.0 * sizes[robot][name] * hz for robot, (name, hz) in sent.items())
    assert bits <= 0.8 * capacity_bps + 1e-6
    assert {name for name, _ in sent.values()} <= {*known.algorithms}
    assert {hz for _, hz in sent.values()} <= {decision.rate_hz, *RARER_HZ}
    assert (len({name for name, _ in sent.values()}) > 1) == (decision.algorithm == MIXED)


def test_the_egos_processor_and_a_robots_bound_what_is_sent() -> None:
    known = knowing()
    found = a_floor(4, capacity_bps=1e9)
    known._works = {
        "early": Work(encode_ms=1.0, fixed_ms=20.0, add_ms=60.0),
        "late": Work(encode_ms=1e4, fixed_ms=20.0, add_ms=1.0),
        "single": Work(encode_ms=0.0, fixed_ms=20.0, add_ms=0.0),
    }
    known.objective = msgspec.structs.replace(known.objective, lambda_compute=0.0)
    decision = decide(found, known)
    busy_s = sum(known.add_s(one.algorithm) * one.rate_hz for one in decision.assignments)
    assert busy_s <= 0.8 + 1e-9
    # Ten seconds of encoding cannot be done once a second, nor every two.
    assert {one.algorithm for one in decision.assignments} == {"early"}


@given(st.dictionaries(st.sampled_from([f"R{i}" for i in range(9)]), st.sampled_from(RARER_HZ)))
def test_the_largest_frame_is_told(rates: dict[str, float]) -> None:
    sizes = {robot: 100 + i for i, robot in enumerate(sorted(rates))}
    given_ = assignments(*((robot, "early", hz) for robot, hz in rates.items()))
    if not given_:
        return
    frames = [sum(sizes[r] for r in in_turn(rates, 10.0, n)) for n in range(200)]
    assert burst(given_, 10.0, sizes) == max(frames)
    assert np.mean(frames) == pytest.approx(sum(sizes[r] * hz / 10.0 for r, hz in rates.items()))


def places_hz(hz: float) -> float:
    return 10.0 if hz >= 2.0 else 5.0


@given(st.dictionaries(st.sampled_from([f"R{i}" for i in range(9)]), st.sampled_from(RARER_HZ)))
def test_nobody_is_asked_about_places_in_a_frame_to_which_it_contributes(
    rates: dict[str, float],
) -> None:
    chosen = tuple(
        Assignment(robot=robot, algorithm="early", rate_hz=hz, places_hz=places_hz(hz))
        for robot, hz in rates.items()
    )
    asked = dict.fromkeys(rates, 0)
    for number in range(200):
        about = about_places(chosen, 10.0, number)
        assert not {*about} & {*in_turn(rates, 10.0, number)}
        for robot in about:
            asked[robot] += 1
    for robot, hz in rates.items():
        # At most what is asked for, and less by no more than the contributions of its own.
        assert places_hz(hz) - hz <= asked[robot] / 20.0 <= places_hz(hz)
    sizes, places = dict.fromkeys(rates, 100), dict.fromkeys(rates, 10)
    if chosen:
        whole, most = burst(chosen, 10.0, sizes), burst(chosen, 10.0, sizes, places)
        assert whole <= most <= whole + 10 * len(rates)


@pytest.mark.parametrize("hz", [5.0, 2.0])
def test_everybody_sends_everything_now_and_then_each_in_another_frame(hz: float) -> None:
    rates = dict.fromkeys(("R2", "R3", "R4"), hz)
    whole: dict[str, list[int]] = {robot: [] for robot in rates}
    counts = dict.fromkeys(rates, 0)
    for number in range(400):
        for robot in in_turn(rates, 10.0, number):
            counts[robot] += 1
            if not of_objects(hz, 10.0, number):
                whole[robot].append(number)
    for robot, numbers in whole.items():
        assert len(numbers) * EVERYTHING == counts[robot]
        assert {*np.diff(numbers).tolist()} == {EVERYTHING * round(10.0 / hz)}
    apart = [*whole.values()]
    assert not {*apart[0]} & {*apart[1]}


def test_places_in_between_cost_bytes_and_time_and_are_worth_it() -> None:
    found = a_floor(3, capacity_bps=1e6)
    without, asking = (Mixes(Scorer(found, knowing(places_hz=hz))) for hz in (0.0, 10.0))
    twice = assignments(("R2", "early", 2.0))
    plain, more = without.score(twice), asking.score(twice)
    assert plain is not None
    assert more is not None
    assert (plain.assignments[0].places_hz, more.assignments[0].places_hz) == (0.0, 10.0)
    size = asking.scorer.size("R2", "early")
    places = found.candidates[0].places_size("early")
    objects = found.candidates[0].contribution_size("early", objects_only=True)
    assert places == math.ceil(PART * size)
    # One of so many contributions is of everything.
    assert objects == math.ceil((size + (EVERYTHING - 1) * OBJECTS_PART * size) / EVERYTHING)
    assert (plain.assignments[0].objects_only, more.assignments[0].objects_only) == (False, True)
    # It contributes to two frames of ten, and is asked about places in the others.
    assert more.cost_bytes == math.ceil((objects * 2.0 + places * 8.0) / 10.0)
    assert more.cost > plain.cost
    # Asked about them less often than was measured, it sends everything.
    fewer = Mixes(Scorer(found, knowing(places_hz=5.0))).score(twice)
    assert fewer is not None
    assert (fewer.assignments[0].places_hz, fewer.assignments[0].objects_only) == (5.0, False)
    assert more.quality > plain.quality
    # What has come counts in the place of a guess.
    known = replace(found.candidates[0], focused={"early": 77}, objects={"early": 500})
    again = replace(found, candidates=(known, *found.candidates[1:]))
    told = Mixes(Scorer(again, knowing(places_hz=10.0))).score(twice)
    assert told is not None
    mean = math.ceil((size + (EVERYTHING - 1) * 500) / EVERYTHING)
    assert told.cost_bytes == math.ceil((mean * 2.0 + 77 * 8.0) / 10.0)
    # So does one that sends all its points though it is asked for objects: it is not asked so.
    all_the_same = replace(found.candidates[0], objects={"early": size})
    again = replace(found, candidates=(all_the_same, *found.candidates[1:]))
    told = Mixes(Scorer(again, knowing(places_hz=10.0))).score(twice)
    assert told is not None
    assert (told.assignments[0].places_hz, told.assignments[0].objects_only) == (10.0, False)
    # A robot of an older program answers with its whole scan: it is not asked about places.
    older = replace(found.candidates[0], focused={"early": size})
    again = replace(found, candidates=(older, *found.candidates[1:]))
    told = Mixes(Scorer(again, knowing(places_hz=10.0))).score(twice)
    assert told is not None
    assert (told.assignments, told.cost_bytes) == (plain.assignments, plain.cost_bytes)
    assert told.quality == plain.quality


@pytest.mark.parametrize("frames_hz", [10.0, 5.0])
@pytest.mark.parametrize("most_hz", [10.0, 5.0])
def test_only_who_sends_points_rarely_is_asked_about_places(
    most_hz: float, frames_hz: float
) -> None:
    found = a_floor(3, capacity_bps=1e6)
    known = knowing(places_hz=most_hz, rate_hz=frames_hz)
    measured_hz = {5.0: 10.0, 2.5: 10.0, 2.0: 10.0, 1.0: 5.0, 0.5: 5.0}
    for option in Mixes(Scorer(found, known)).options:
        often = min(frames_hz, most_hz, measured_hz.get(option.rate_hz, 0.0))
        asked = option.algorithm == "early" and often > option.rate_hz
        assert option.places_hz == (often if asked else 0.0)


def test_sizes_of_answers_about_places_are_learnt_beside_those_of_whole_ones() -> None:
    known = knowing()
    for size in (300, 400, 500):
        known.record_payload("R2", "early", size, NOW_NS, focused=True)
    assert known.payload_sizes("R2", {"early": 3000}, NOW_NS)["early"] == 3000
    assert known.focused_sizes("R2", NOW_NS) == {"early": 400}
    assert known.focused_sizes("R3", NOW_NS) == {}


def test_an_algorithm_that_cannot_be_mixed_is_left_out() -> None:
    known = knowing()
    known.mixable = frozenset({"late"})
    decision = decide(a_floor(3, capacity_bps=1e6), known)
    assert {one.algorithm for one in decision.assignments} <= {"late"}


@pytest.mark.parametrize("seed", range(10))
def test_what_q_min_takes_is_less_where_robots_may_send_less_often(seed: int) -> None:
    found = a_floor(seed, capacity_bps=1e6)
    whole, rarer = need(found, knowing(rarer_hz=())), need(found, knowing())
    assert rarer.possible == whole.possible
    assert rarer.bytes_s <= whole.bytes_s
    if rarer.possible and rarer.bytes_s:
        # On a cell of that width coverage reaches Q_min.
        narrow = replace(found, capacity_bps=8.0 * rarer.bytes_s)
        assert decide(narrow, knowing()).quality >= 0.7 - ROUNDING


def test_the_demand_tells_mean_and_burst() -> None:
    found, known = a_floor(3, capacity_bps=1e6), knowing()
    decision = decide(found, known)
    said = DemandMeter().take(found, known, decision, sent_ns=1, now_s=0.0)
    assert decision.assignments
    sizes = {c.robot: c.sizes for c in found.candidates}
    sent = {one.robot: sizes[one.robot][one.algorithm] for one in decision.assignments}
    mean = sum(sent[one.robot] * one.rate_hz for one in decision.assignments)
    assert said.mean_bytes_s == pytest.approx(mean, abs=10)
    assert max(sent.values()) <= said.burst_bytes <= sum(sent.values())


def test_a_line_of_the_journal_holds_the_assignments() -> None:
    found = a_floor(3, capacity_bps=1e6)
    decision = decide(found, knowing())
    seen = snapshot(view("R1"), ego="R1")
    line = cycle_record(seen, found, decision, Tally(), published=True, cycle_ms=1.0)
    again = msgspec.json.decode(msgspec.json.encode(line), type=CycleRecord)
    assert again.decision.assignments == decision.assignments != ()


def test_a_scene_file_may_tell_assignments_of_the_decision_in_force() -> None:
    example = json.loads(EXAMPLE.read_text())
    sends = {"robot": "R3", "algorithm": "late", "rate_hz": 2.0}
    example["previous"] = {"participants": ["R1", "R3"], "algorithm": "late"}
    example["previous"]["assignments"] = [sends]
    previous = read_scene(json.dumps(example).encode(), NOW_NS).previous
    assert previous is not None
    assert previous.assignments == (Assignment(robot="R3", algorithm="late", rate_hz=2.0),)


@pytest.mark.parametrize("seed", range(6))
def test_what_each_brings_is_what_the_choice_loses_without_it(seed: int) -> None:
    mixes = Mixes(Scorer(a_floor(seed), knowing()))
    first, *others = mixes.scorer.scene.candidates
    given_ = [mixes.options_of(c.robot)[0] for c in others]
    brought = mixes.brought(given_)
    whole = mixes.score(given_)
    assert whole is not None
    assert {*brought} == {c.robot for c in (first, *others)}
    for one in given_:
        without = mixes.score([other for other in given_ if other is not one])
        assert without is not None
        lost = whole.quality - without.quality
        assert brought[one.robot].adds == pytest.approx(lost, abs=0.01)
        assert brought[one.robot].costs == pytest.approx(whole.cost - without.cost)
    joined = mixes.score([*given_, brought[first.robot].sends])
    assert joined is not None
    assert brought[first.robot].adds == pytest.approx(joined.quality - whole.quality, abs=0.01)


def test_who_is_preferred_may_cost_more() -> None:
    found = a_floor(2)
    liked = found.candidates[0].robot
    known = knowing(lambda_compute=0.1)
    plain, asked = (
        Mixes(Scorer(one, known)).brought(())
        for one in (found, replace(found, preferred=frozenset({liked})))
    )
    assert asked[liked].costs < plain[liked].costs


@pytest.mark.parametrize("by_byte", [True, False])
def test_on_the_way_nobody_is_credited_with_what_it_sends_no_more(by_byte: bool) -> None:
    """Boxes twice a second that are as good as boxes always are better in that than points once."""
    known = Knowledge(Objective(rarer_hz=RARER_HZ, lambda_link=0.002), BOTH)
    for capacity_bps in (4e5, 8e5, 1.2e6, 2e6):
        mixes = Mixes(Scorer(a_floor(3, capacity_bps=capacity_bps), known))
        grown = mixes.grow(by_byte=by_byte)
        again = mixes.score(grown.assignments)
        assert again is not None
        assert not grown.assignments or again.quality == pytest.approx(grown.quality, abs=1e-5)


def test_assignments_at_a_slower_pace_are_carried_on_at_that_pace() -> None:
    found = a_floor(3)
    known = knowing(slower_hz=(5.0, 2.5))
    mixes = Mixes(Scorer(found, known))
    slow = Mixes(mixes.scorer.at_rate(2.5))
    sends = tuple(slow.options_of(robot)[0] for robot in ("R2", "R3"))
    first = msgspec.structs.replace(
        decide(found, known), rate_hz=2.5, participants=("R1", "R2", "R3"), assignments=sends
    )
    held = still_possible(mixes.scorer, first, mixes)
    assert held is not None
    assert (held.pace.rate_hz, held.assignments) == (2.5, slow.score_able(sends).assignments)
    assert still_possible(mixes.scorer, msgspec.structs.replace(first, rate_hz=3.0), mixes) is None


def test_that_a_robot_sends_a_part_or_everything_begins_no_decision_anew() -> None:
    found = a_floor(3)
    first = msgspec.structs.replace(decide(found, knowing(places_hz=10.0)), held_s=4.0)
    assert first.assignments
    parts = [msgspec.structs.replace(one, objects_only=True) for one in first.assignments]
    other = msgspec.structs.replace(first, assignments=tuple(parts), decided_ns=NOW_NS + 10**9)
    assert held(other, first, NOW_NS + 10**9).held_s == pytest.approx(5.0)
    rarer = [msgspec.structs.replace(one, rate_hz=0.5) for one in first.assignments]
    assert held(msgspec.structs.replace(other, assignments=tuple(rarer)), first, NOW_NS).held_s == 0
