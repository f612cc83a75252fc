"""No decision of any policy breaks a hard wish; soft ones shift what is chosen."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from msgspec.structs import replace

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.intents.bind import Known, bound_objective, bound_scene, inside
from ego_agent.plan.intents.combine import Standing, standing
from ego_agent.plan.intents.obey import plan_obeying
from ego_agent.plan.intents.told import told
from ego_agent.plan.policies.registry import make_policy, policy_names
from swarm.messages import Decision, Focus, Intent, IntentInForce, Place, decode, encode
from tests.support.ego_scenes import BOTH, NOW_NS, assert_valid, candidate, scene, snapshot

ALGORITHMS = ("early", "intermediate", "late")
ROBOTS = ("A", "B", "C", "D", "F", "G")
POLICIES = tuple(n for n in policy_names() if n.count("-") < 2)
"""Without those of algorithms that these scenes know nothing of."""
SIDE = 40
DOCKS = Place("docks", ((5.0, 5.0), (20.0, 5.0), (20.0, 20.0), (5.0, 20.0)))


def in_force(intent: Intent, number: int = 1) -> IntentInForce:
    return IntentInForce(number=number, intent=intent, operator="ann", places=(DOCKS,))


def random_scene(rng: np.random.Generator, robots: int) -> UnifiedScene:
    """An ego and robots that each see a rectangle of the floor and some of eight objects."""

    def one(robot: str) -> Candidate:
        low = rng.integers(0, SIDE - 10, 2)
        high = low + rng.integers(4, 25, 2)
        rows, columns = np.mgrid[0:SIDE, 0:SIDE]
        seen = (rows >= low[0]) & (rows < high[0]) & (columns >= low[1]) & (columns < high[1])
        sizes = {
            "early": int(rng.integers(5_000, 40_000)),
            "intermediate": int(rng.integers(1_000, 8_000)),
            "late": int(rng.integers(100, 900)),
        }
        evidence = rng.random(8) * (rng.random(8) < 0.5)
        return candidate(
            robot,
            np.flatnonzero(seen.ravel()).tolist(),
            evidence.tolist(),
            of=(SIDE, 8),
            sizes=sizes,
            distance_m=float(rng.uniform(1, 40)),
        )

    ego = one("E")
    return scene(ego, *(one(r) for r in ROBOTS[:robots]), capacity_bps=10 ** rng.uniform(4.5, 8))


def random_intent(rng: np.random.Generator) -> Intent:
    some = [r for r in (*ROBOTS, "ghost") if rng.random() < 0.3]
    others = [r for r in ROBOTS if r not in some and rng.random() < 0.6]
    return Intent(
        exclude=tuple(some),
        only=tuple(others) if rng.random() < 0.3 else None,
        prefer=tuple(others[:1]),
        focus=(Focus("docks", "high" if rng.random() < 0.5 else "low"),)
        if rng.random() < 0.5
        else (),
        q_min=float(rng.uniform(0.2, 1)) if rng.random() < 0.6 else None,
        link_share=float(rng.uniform(0.02, 1)) if rng.random() < 0.5 else None,
        save="bandwidth" if rng.random() < 0.3 else None,
        policy=str(rng.choice(POLICIES)) if rng.random() < 0.3 else None,
    )


def best_quality(found: UnifiedScene, known: Knowledge) -> float:
    """Of all choices that the link carries at the fastest pace."""
    scorer = Scorer(found, known)
    names = [c.robot for c in found.candidates]
    scores = (
        scorer.score(chosen, algorithm)
        for algorithm in known.algorithms
        for count in range(len(names) + 1)
        for chosen in itertools.combinations(names, count)
    )
    return max(score.quality for score in scores if scorer.fits(score))


def decided(
    intent: Intent | Standing,
    found: UnifiedScene,
    known: Knowledge,
    policy: str,
    previous: Decision | None = None,
) -> tuple[Decision, UnifiedScene, Knowledge]:
    wishes = intent if isinstance(intent, Standing) else standing([in_force(intent)])
    aimed = known.aiming_at(bound_objective(known.objective, wishes))
    bound = bound_scene(found, wishes)
    name = wishes.policy.value if wishes.policy else policy
    asked = make_policy(name, ALGORITHMS)
    decision = plan_obeying(snapshot(), bound, asked, aimed, previous, 9, NOW_NS, wishes)
    return decision, bound, aimed


@pytest.mark.parametrize("policy", POLICIES)
def test_over_200_random_intents_and_scenes_no_decision_breaks_a_hard_wish(policy: str) -> None:
    rng = np.random.default_rng(7)
    reached = missed = 0
    for _ in range(200):
        found = random_scene(rng, int(rng.integers(0, len(ROBOTS) + 1)))
        rarer = (5.0, 2.0) if rng.random() < 0.5 else ()
        known = Knowledge(Objective(q_min=0.5, slower_hz=(5.0, 2.0), rarer_hz=rarer), ALGORITHMS)
        before = decided(Intent(), found, known, policy)[0]
        intent = random_intent(rng)
        decision, bound, aimed = decided(intent, found, known, policy, before)
        if not decision.assignments:
            assert_valid(decision, bound, aimed)
        others = {*decision.participants[1:], *(one.robot for one in decision.assignments)}
        assert not others & set(intent.exclude)
        if intent.only is not None:
            assert others <= set(intent.only)
        if intent.link_share is not None and others:
            used = decision.cost_bytes * 8 * decision.rate_hz
            assert used <= intent.link_share * found.capacity_bps
        if intent.policy is not None:
            assert decision.policy == intent.policy
        if intent.q_min is not None and decision.quality < intent.q_min:
            missed += best_quality(bound, aimed) >= intent.q_min
        elif intent.q_min is not None:
            reached += 1
    assert reached > 20
    assert missed == 0


def test_every_policy_keeps_to_q_min_where_coverage_reaches_it() -> None:
    floor = scene(candidate("E", range(20)), candidate("A", range(20, 64)))
    known = Knowledge(Objective(q_min=0.0), BOTH)
    missed = 0
    for _ in range(20):
        free = decided(Intent(policy="random"), floor, known, "coverage")[0]
        missed += free.quality < 0.9
        wished = decided(Intent(policy="random", q_min=0.9), floor, known, "coverage")[0]
        assert wished.quality >= 0.9
        assert wished.policy == "random"
    assert missed


def test_a_q_min_that_nobody_reaches_leaves_the_best_and_says_so() -> None:
    floor = scene(candidate("E", range(20)), candidate("A", range(20, 64)))
    wishes = standing([in_force(Intent(q_min=0.99, exclude=("A",)))])
    decision, bound, _ = decided(wishes, floor, Knowledge(Objective(), BOTH), "coverage")
    assert decision.participants == ("E",)
    (report,) = told(decision, bound, wishes)
    assert report.bound == ("A left out", "Q 0.31 is the best, below 0.99")
    assert bound.excluded["A"] == "left out by wish 1 of ann"


def test_who_is_left_out_is_not_forgotten_in_what_all_could_show() -> None:
    floor = scene(candidate("E", range(16)), candidate("A", range(16, 64)))
    known = Knowledge(Objective(), BOTH)
    alone = decided(Intent(exclude=("A",)), floor, known, "coverage")[0]
    with_all = Scorer(floor, known).score((), "early")
    assert alone.quality == pytest.approx(with_all.quality)
    assert alone.quality < 0.3


def test_places_lie_where_they_are_drawn() -> None:
    floor = scene(candidate("E", (), of=(SIDE, 4), distance_m=0))
    cells = inside(floor, [DOCKS])
    assert cells.sum() == 15 * 15
    assert cells[SIDE // 2 + 5 : SIDE, SIDE // 2 + 5 : SIDE].sum() == 15 * 15
    dent = Place("dent", ((0, 0), (10, 0), (10, 10), (5, 5), (0, 10)))
    assert inside(floor, [dent]).sum() == pytest.approx(75, abs=5)


def lower_and_upper() -> UnifiedScene:
    """A sees the upper half of the floor, with the docks; B more ground in the lower half."""
    half = SIDE * SIDE // 2
    return scene(
        candidate("E", (), of=(SIDE, 4), distance_m=0),
        candidate("A", range(half + 200, 2 * half), of=(SIDE, 4)),
        candidate("B", range(half), of=(SIDE, 4)),
        capacity_bps=12_000 * 8 * 10 / 0.8 * 1.5,
    )


@pytest.mark.parametrize(("weight", "chosen"), [("high", "A"), ("low", "B")])
def test_a_place_that_counts_more_draws_those_who_see_it(weight: str, chosen: str) -> None:
    known = Knowledge(Objective(), ("early",))
    assert decided(Intent(), lower_and_upper(), known, "coverage")[0].participants == ("E", "B")
    focus = Focus("docks", "high" if weight == "high" else "low")
    decision = decided(Intent(focus=(focus,)), lower_and_upper(), known, "coverage")[0]
    assert decision.participants == ("E", chosen)


def test_a_class_that_counts_more_draws_those_who_see_it() -> None:
    floor = scene(
        candidate("E", (), [0, 0, 0]),
        candidate("A", (), [1, 0, 0]),
        candidate("B", (), [0, 1, 1]),
        capacity_bps=12_000 * 8 * 10 / 0.8 * 1.5,
    )
    floor.objects[:3, 0] = (1, 5, 9)
    people = Known(("person", "forklift"), np.array([[1.5, 0.5], [50, 0]], dtype=np.float32))
    wishes = standing([in_force(Intent(classes={"person": "high"}))])
    known = Knowledge(Objective(), ("early",))
    coverage = make_policy("coverage", ("early",))
    for labels, chosen in ((people, "A"), (Known(), "B")):
        bound = bound_scene(floor, wishes, labels)
        decision = plan_obeying(snapshot(), bound, coverage, known, None, 1, NOW_NS, wishes)
        assert decision.participants == ("E", chosen)


def test_a_preferred_robot_is_asked_where_another_is_hardly_better() -> None:
    known = Knowledge(Objective(), ("early",))
    for near, chosen in ((780, "A"), (200, "B")):
        half = SIDE * SIDE // 2
        floor = scene(
            candidate("E", (), of=(SIDE, 4), distance_m=0),
            candidate("A", range(half, half + near), of=(SIDE, 4)),
            candidate("B", range(half), of=(SIDE, 4)),
            capacity_bps=12_000 * 8 * 10 / 0.8 * 1.5,
        )
        assert decided(Intent(), floor, known, "coverage")[0].participants == ("E", "B")
        wished = decided(Intent(prefer=("A",)), floor, known, "coverage")[0]
        assert wished.participants == ("E", chosen)


def test_saving_makes_what_is_saved_dearer() -> None:
    base = Objective()
    saved = bound_objective(base, standing([in_force(Intent(save="bandwidth"))]))
    assert (saved.lambda_link, saved.lambda_compute) == (4 * base.lambda_link, base.lambda_compute)
    saved = bound_objective(base, standing([in_force(Intent(save="compute"))]))
    assert (saved.lambda_link, saved.lambda_compute) == (base.lambda_link, 4 * base.lambda_compute)


def test_a_decision_tells_its_intents_in_a_message() -> None:
    wishes = standing([in_force(Intent(link_share=0.5, policy="rules", prefer=("A",)))])
    floor = scene(candidate("E", range(20)), candidate("A", range(20, 64)))
    decision, bound, _ = decided(wishes, floor, Knowledge(Objective(), BOTH), "coverage")
    (report,) = told(decision, bound, wishes)
    assert report.says == "rather ask A; use at most 50 % of the link; decide by rules"
    assert report.bound == (
        "observations take 0.96 of at most 10.00 Mbit/s",
        "rules decides",
        "A preferred",
    )
    whole = replace(decision, intents=(report,))
    assert decode(encode(whole), Decision) == whole


def test_a_wish_of_hundreds_of_names_fits_a_decision() -> None:
    names = tuple(f"a-robot-with-a-long-name-{n}" for n in range(250))
    wishes = standing([in_force(Intent(exclude=names))])
    others = [candidate(name, [n % 64]) for n, name in enumerate(names)]
    bound = bound_scene(scene(candidate("E", [0]), *others), wishes)
    known = Knowledge(Objective(), BOTH)
    decision = plan_obeying(
        snapshot(ego="E"), bound, make_policy("coverage", BOTH), known, None, 1, NOW_NS, wishes
    )
    said = replace(decision, intents=told(decision, bound, wishes))
    (report,) = decode(encode(said), Decision).intents
    assert report.says.endswith("and more")
    assert report.bound[0].endswith("and more")
