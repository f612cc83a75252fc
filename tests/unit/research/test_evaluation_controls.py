"""Controls of policies: as many, the same way, on the same link; and when a policy is better."""

from __future__ import annotations

import json
import random
from collections import Counter

import pytest

from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.validation import Unusable, validate
from ego_agent.plan.prompting import make_prompt
from llm_gateway.answers import extract
from llm_gateway.schemas import Schemas
from research.evaluation.bootstrap import Interval
from research.evaluation.policies.beside import Comparison, beside_controls, controls_table
from research.evaluation.policies.claims import claims_of
from research.evaluation.policies.controls import at_random, controls, first, is_control
from research.evaluation.policies.decide import Decided, decisions, policy_of
from research.evaluation.policies.guessing import RandomJudged, drawn
from research.evaluation.policies.results import Row, means_of
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.windows import announcements, links
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.measure import Window
from research.evaluation.windows.scenarios import Scenario
from research.training.plans import TEST_SEEDS
from tests.support.ego_scenes import assert_valid, candidate, knowledge, proposal, scene
from tests.support.prompt_scenes import floor

SIZES = {"A": 1_000, "B": 3_000, "C": 5_000, "D": 20_000}
CELLS = {"A": [8], "B": [8, 9, 10], "C": [10, 11], "D": range(20, 60)}
"""D sees most, then B; C adds one cell to B, and A nothing to either."""
SCENARIO = Scenario("small", 4, links.shift(), TEST_SEEDS.start + 555_556, windows=2)


def scorer(budget: int) -> Scorer:
    robots = [candidate(r, CELLS[r], sizes={"early": size}) for r, size in SIZES.items()]
    robots.append(candidate("E", [1, 2], sizes={"late": 100}))
    return Scorer(scene(candidate("R1", [0]), *robots), knowledge(), budget_bytes=budget)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_as_many_are_drawn_at_random_from_those_that_can_send(count: int) -> None:
    choice = Choice(("A", "B", "C", "D")[:count], "early")
    seen = Counter(
        robot
        for seed in range(200)
        for robot in at_random(scorer(1 << 30), choice, random.Random(seed))
    )
    assert set(seen) == set(SIZES), "E has no size for early"
    assert sum(seen.values()) == 200 * count
    assert max(seen.values()) - min(seen.values()) < 60


def test_random_sets_fit_the_link_or_lose_the_largest() -> None:
    two = Choice(("A", "B"), "early")
    draws = [set(at_random(scorer(6_000), two, random.Random(seed))) for seed in range(50)]
    assert {frozenset(one) for one in draws} == {frozenset("AB"), frozenset("AC")}
    fewer = {at_random(scorer(3_500), two, random.Random(seed)) for seed in range(50)}
    assert fewer <= {("A",), ("B",), ()}
    assert at_random(scorer(6_000), Choice((), ALONE), random.Random(1)) == ()


@pytest.mark.parametrize(
    ("count", "budget", "wanted"),
    [
        (1, 1 << 30, ("D",)),
        (2, 1 << 30, ("D", "B")),
        (4, 1 << 30, ("D", "B", "C", "A")),
        (2, 10_000, ("B", "C")),
        (3, 7_000, ("B", "A")),
        (0, 1 << 30, ()),
    ],
)
def test_the_first_by_coverage_are_as_many_as_the_link_carries(
    count: int, budget: int, wanted: tuple[str, ...]
) -> None:
    choice = Choice(tuple("ABCD"[:count]), "early" if count else ALONE)
    assert first(scorer(budget), choice) == wanted


def test_every_guess_is_one_that_the_schema_admits_and_validation_accepts() -> None:
    known = knowledge()
    for capacity_bps in (2e5, 1e6, 5e6, 55e6):
        found = floor(6, known, capacity_bps)
        asked = make_prompt(found, known, None, None)
        chosen = Counter[tuple[str, int]]()
        for seed in range(40):
            algorithm, helpers = drawn(Scorer(found, known), random.Random(seed))
            said = {"algorithm": algorithm, "helpers": helpers}
            said |= {"confidence": "low", "explanation": ""}
            assert extract(json.dumps(said), asked.schema, Schemas())
            decision = validate(
                proposal("R1", *helpers, algorithm=algorithm), found, known,
                policy="guess", cycle=0, now_ns=0,
            )  # fmt: skip
            assert not isinstance(decision, Unusable)
            assert_valid(decision, found, known)
            assert set(decision.participants) == {"R1", *helpers}, "nothing is left to repair"
            chosen[algorithm, len(helpers)] += 1
        if capacity_bps == 55e6:
            assert len(chosen) == 4, "both algorithms, and what Q_min and the link leave of each"


@pytest.mark.slow
def test_controls_differ_from_a_policy_in_who_takes_part_alone() -> None:
    known = knowledge_of(("early", "late"), SCENARIO)
    window = Window(SCENARIO, 0)
    fusions = {name: window.fusion(name) for name in known.algorithms}
    heard = [announcements.heard(window.world, at, window.ego, dict(fusions)) for at in (0, 50)]
    decided = decisions(SCENARIO, heard, known, policy_of("coverage", SCENARIO, known))
    beside = controls(SCENARIO, heard, known, decided)
    assert beside == controls(SCENARIO, heard, known, decided), "draws repeat"
    assert [one.policy for one in beside] == 2 * ["coverage~random", "coverage~first"]
    assert all(is_control(one.policy) and one.source == "control" for one in beside)
    for one, control in zip([d for d in decided for _ in "12"], beside, strict=True):
        assert control.window == one.window
        assert len(control.choice.participants) == len(one.choice.participants) > 0
        assert control.choice.algorithm == one.choice.algorithm
        assert control.answered is None
    for name in ("static-late", "random", "rules"):
        found = decisions(SCENARIO, heard, known, policy_of(name, SCENARIO, known))
        assert controls(SCENARIO, heard, known, found) == []
    guess = RandomJudged(SCENARIO.seed)
    judged = decisions(SCENARIO, heard, known, guess)
    assert {one.source for one in judged} <= {"llm", "hold", "fallback"}
    assert controls(SCENARIO, heard, known, judged) == []


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [(0.01, 0.02, "better"), (-0.01, 0.02, "no better"), (-0.02, -0.01, "worse")],
)
def test_better_is_what_is_above_0_in_the_whole_interval(
    low: float, high: float, words: str
) -> None:
    gained = Interval((low + high) / 2, low, high)
    enough = Comparison("a", "a~first", "", 30, 20, 10, gained, gained)
    assert enough.plain()["value_verdict"] == enough.plain()["delivered_verdict"] == words
    few = Comparison("a", "a~first", "", 30, 20, 4, gained, gained)
    assert few.plain()["value_verdict"] == "too few to tell"


def row(policy: str, window: int, ap_70: float, infeasible: bool = False) -> Row:
    choice = Choice(("R2",), "early")
    decided = Decided(
        f"floor-{window}", window, ("R1", "R2"), "R1", ("R2",), policy, choice, 10, "", "policy",
        0.01,
    )  # fmt: skip
    scenario = Scenario(f"floor-{window}", 2, links.shift())
    outcome = Outcome(ap_70, ap_70, ap_70, 10.0, 4, 9, None)
    arrived = 0.3 if infeasible else ap_70
    return Row(scenario, decided, outcome, 5e6, infeasible, arrived, arrived - 1e-5, 0.0, None)


def test_every_policy_stands_beside_its_own_controls() -> None:
    rows = []
    for window in range(12):
        rows += [
            row("static-early", window, 0.9),
            row("coverage", window, 0.8 + 0.001 * window),
            row("coverage~random", window, 0.7),
            row("coverage~first", window, 0.8 + 0.001 * (11 - window)),
            row("llm-x", window, 0.6),
            row("llm-x~random", window, 0.6, infeasible=True),
            row("random-judged", window, 0.75),
        ]
    found = {(one.policy, one.control): one for one in beside_controls(rows)}
    assert set(found) == {
        ("coverage", "coverage~random"),
        ("coverage", "coverage~first"),
        ("llm-x", "llm-x~random"),
        ("llm-x", "random-judged"),
    }
    better = found["coverage", "coverage~random"]
    assert better.windows == 12
    assert better.differing == 0
    assert better.value.mean == pytest.approx(0.1055)
    assert better.plain()["value_verdict"] == "better"
    assert found["coverage", "coverage~first"].plain()["value_verdict"] == "no better"
    assert found["llm-x", "llm-x~random"].delivered_ap_70.mean == pytest.approx(0.3)
    assert found["llm-x", "random-judged"].plain()["delivered_verdict"] == "worse"
    assert "random choices that are judged alike" in controls_table(list(found.values()))
    means = means_of(rows)
    assert {m.policy for m in means if m.decision_ms_p50 is None} == {
        "coverage~random", "coverage~first", "llm-x~random",
    }  # fmt: skip
    claims = {claim["what"]: claim["met"] for claim in claims_of(means, rows)}
    end = "lower end of the interval of value"
    assert claims[f"coverage: better than random choices of as many, {end}"]
    assert not claims[f"coverage: better than the first of as many by coverage, {end}"]
    assert not claims[f"llm-x: better than random choices that are judged alike, {end}"]
