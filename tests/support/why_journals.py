"""Journals of all kinds, made by the ego's own stages, for the tests of explanations."""

from __future__ import annotations

import dataclasses
import random

import msgspec

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.answers import AnswerTimes, Pool, Weighted
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.journal import CycleRecord
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import SLOWER_HZ
from ego_agent.knowledge.record import cycle_record
from ego_agent.knowledge.tally import Tally
from ego_agent.plan.choices.options import compare
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.weigh import weigh
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.registry import make_policy
from swarm.messages import ALGORITHMS, Decision, IntentTold
from tests.support.ego_scenes import snapshot
from tests.support.prompt_scenes import views

POLICIES = ("coverage", "coverage", "rules", "static-late", "static-early", "random")
SECOND_NS = 1_000_000_000


def journal(rng: random.Random, cycles: int) -> list[CycleRecord]:
    """The lines of an ego whose robots come and go, whose link changes and that is steered."""
    everyone = views(rng.randint(1, 9) if rng.random() < 0.95 else 25)
    names = {view.robot for view in everyone}
    found: list[CycleRecord] = []
    previous: Decision | None = None
    policy, q_min = rng.choice(POLICIES), rng.choice((0.0, 0.6, 0.7, 0.75, 0.95))
    capacity_bps = 10 ** rng.uniform(4.5, 8.5)
    there = set(names)
    for cycle in range(1, cycles + 1):
        if rng.random() < 0.3:
            capacity_bps *= rng.choice((0.1, 0.5, 0.97, 1.04, 3.0))
        if rng.random() < 0.3:
            there = {"R1"} | {name for name in sorted(names) if rng.random() < 0.8}
        if rng.random() < 0.1:
            policy = rng.choice(POLICIES)
        if rng.random() < 0.1:
            q_min = rng.choice((0.5, 0.65, 0.8))
        known = Knowledge.of_detector(
            "factory", Objective(q_min=q_min, slower_hz=SLOWER_HZ), ALGORITHMS
        )
        alive = [
            dataclasses.replace(view, alive=view.robot in there)
            for view in everyone
            if view.robot in there or rng.random() < 0.7
        ]
        taken = dataclasses.replace(
            snapshot(*alive, ego="R1", capacity_bps=capacity_bps), cycle=cycle
        )
        scene = _varied(analyze(taken, known), rng)
        made = plan(
            taken,
            scene,
            make_policy(policy, known.algorithms),
            known,
            previous,
            cycle,
            taken.now_ns + cycle * SECOND_NS,
        )
        made = previous = _told(made, rng)
        old = rng.random() < 0.15
        line = cycle_record(
            taken,
            scene,
            made,
            Tally(),
            published=True,
            cycle_ms=1.0,
            weighed=None if old else weigh(compare(Scorer(scene, known)), made),
        )
        found.append(line)
    return found


def _varied(scene: UnifiedScene, rng: random.Random) -> UnifiedScene:
    """Some robots with narrow links of their own, with late answers, or of unknown sizes."""

    def changed(candidate: Candidate) -> Candidate:
        frames = rng.uniform(1.0, 9.0)
        late = AnswerTimes(own=Pool.of([Weighted(0.6, frames, frames)]), frames=9.0)
        if rng.random() < 0.1:
            candidate = dataclasses.replace(candidate, capacity_bps=10 ** rng.uniform(4, 7))
        if rng.random() < 0.1:
            candidate = dataclasses.replace(candidate, answers={"early": late})
        if rng.random() < 0.1:
            sizes = {a: n for a, n in candidate.sizes.items() if a != "early"}
            candidate = dataclasses.replace(candidate, sizes=sizes)
        return candidate

    return dataclasses.replace(scene, candidates=tuple(map(changed, scene.candidates)))


def _told(decision: Decision, rng: random.Random) -> Decision:
    """Now and then with a model, with silent robots, blind, or in the fallback's name."""
    changes: dict[str, object] = {}
    if rng.random() < 0.1:
        changes |= {"model": "small-135M", "policy": "llm", "source": "hold"}
    elif rng.random() < 0.1:
        changes |= {"policy": "llm", "source": "fallback", "repairs": ("refused: it is worse",)}
    if rng.random() < 0.1 and len(decision.participants) > 1:
        changes["silent"] = {decision.participants[1]: "nothing has come for 3.1 s"}
    if rng.random() < 0.05:
        changes["blind"] = "nobody is heard"
    changes["intents"] = tuple(
        IntentTold(
            number=number,
            operator=rng.choice(("", "lead")),
            since_ns=1,
            until=None,
            says="leave R3 alone",
            bound=("R3 left out",) if rng.random() < 0.5 else (),
        )
        for number in range(1, 4)
        if rng.random() < 0.1
    )
    return msgspec.structs.replace(decision, **changes)
