"""Ways that are decided: once a second, by a policy, from what robots have told until then."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from msgspec.structs import replace

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import (
    PLACES_HZ,
    RARER_HZ,
    about_places,
    algorithm_of,
    due,
    sends_objects,
    stride,
)
from ego_agent.knowledge.placing import Placing
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.policies.registry import make_policy
from llm_gateway.backends.llamacpp.models import ADAPTER, DEFAULT_MODEL
from llm_gateway.model import Prompt
from research.evaluation.policies.advice import MADE_FROM, AdvisedAtOnce, Answer, Model
from research.evaluation.policies.decide import as_proposed
from research.evaluation.result_store import ResultStore
from research.evaluation.ways.drive import Focus
from research.evaluation.windows.announcements import EPOCH_NS, Announced, snapshot
from swarm.messages import MIXED, Assignment, Decision
from worlds.base import World

ALGORITHMS = ("early", "late")
"""What is decided among: whole maps of features fit none of the links."""
DECIDED_S = 1.0
RANDOM = "random-assignments"
TRAINED, GUESSED = "llm-trained", "llm-guessed"
"""The ego's policy `llm`, asking by the short prompt: the embedded model as it was trained, or any
answer that the prompt allows."""
KEPT = Path("build/eval/kept")


class Drivable(Protocol):
    """What is known of a drive."""

    @property
    def world(self) -> World:
        """Where it is."""
        ...

    @property
    def ego(self) -> str:
        """Who decides."""
        ...

    @property
    def comm_range_m(self) -> float:
        """How far from the ego a robot may take part."""
        ...

    def heard(self, frame: int, algorithms: Sequence[str]) -> Announced:
        """What the ego has heard by then, with sizes of those algorithms."""
        ...

    @property
    def seed(self) -> int:
        """Of chance."""
        ...


@dataclass(frozen=True, slots=True)
class Decided:
    """How it is decided who sends what."""

    policy: str
    """Of the product's, or RANDOM, TRAINED, GUESSED."""
    rarer: bool = False
    """Whether each robot may have an algorithm and a rate of its own."""
    price: float = 1.0
    """Of bytes and processors, against the usual one; 0: as good as the link carries."""
    places: bool = True
    """Where `rarer`: whether robots are asked in between about places."""
    validated: bool = True
    """Whether what the policy proposes is repaired to what the link carries, as an ego does."""
    learns: bool = True
    """Whether it heeds whose contributions could not be laid in their places, as an ego does."""

    @property
    def asks_about_places(self) -> bool:
        """Whether robots may be asked about places in between."""
        return self.rarer and self.places


class Deciding:
    """The decisions of one drive."""

    def __init__(self, drive: Drivable, how: Decided, known_bps: Callable[[float], float]) -> None:
        """`known_bps`: C(t) as the ego knows it, by seconds of the drive."""
        self._drive = drive
        self._known_bps = known_bps
        self._how = how
        objective = Objective(
            comm_range_m=drive.comm_range_m,
            rarer_hz=RARER_HZ if how.rarer else (),
            places_hz=PLACES_HZ if how.asks_about_places else 0.0,
        )
        objective = replace(
            objective,
            lambda_link=objective.lambda_link * how.price,
            lambda_compute=objective.lambda_compute * how.price,
        )
        self._now_s = 0.0
        self._knowledge = Knowledge.of_detector(
            drive.world.detector, objective, ALGORITHMS, learns=how.learns
        )
        # Beside sizes, all that an ego learns that happens here.
        self._knowledge.placing = Placing(lambda: self._now_s)
        self._policy = _policy(how.policy, drive.seed)
        self._every = max(1, round(DECIDED_S * drive.world.rate_hz))
        self._decision: Decision | None = None

    @property
    def participants(self) -> tuple[str, ...]:
        """Who takes part by the decision in force, the ego apart."""
        return self._decision.participants[1:] if self._decision else ()

    @property
    def assignments(self) -> tuple[Assignment, ...]:
        """Who sends what, and how often, by the decision in force."""
        decision = self._decision
        if decision is None or decision.assignments:
            return decision.assignments if decision else ()
        return tuple(
            Assignment(robot=one, algorithm=decision.algorithm, rate_hz=decision.rate_hz)
            for one in self.participants
        )

    def asked(self, number: int, frame: int) -> Mapping[str, str]:
        """The robots that send in the frame, the drive's so many-th, and what."""
        if number % self._every == 0 or self._decision is None:
            self._decision = self._decide(number, frame)
        decision = self._decision
        step = stride(decision, self._drive.world.rate_hz, self._drive.world.rate_hz)
        if number % step:
            return {}
        return {
            robot: algorithm_of(decision, robot)
            for robot in decision.participants[1:]
            if due(decision, robot, number // step)
        }

    def asked_about(self, number: int) -> Mapping[str, str]:
        """The robots that are asked about places in that frame, by the decision in force after
        `asked`, and what."""
        decision = self._decision
        rate_hz = self._drive.world.rate_hz
        if decision is None or number % (step := stride(decision, rate_hz, rate_hz)):
            return {}
        robots = about_places(decision.assignments, decision.rate_hz, number // step)
        return {robot: algorithm_of(decision, robot) for robot in robots}

    def objects(self, number: int) -> frozenset[str]:
        """Who sends only what may be an object to that frame, by the decision in force after
        `asked`."""
        decision, rate_hz = self._decision, self._drive.world.rate_hz
        if decision is None:
            return frozenset()
        return sends_objects(decision, number // stride(decision, rate_hz, rate_hz))

    def heed(self, placed: Mapping[str, bool]) -> None:
        """Notes who of those that were asked for everything could be laid in their places."""
        for robot, well in placed.items():
            self._knowledge.placing.record(robot, placed=well)

    def receive(
        self, asked: Mapping[str, str], sizes: Mapping[str, int], places: Mapping[str, Focus]
    ) -> None:
        """Notes the bytes of what robots send to a frame; `places`: what those were asked about
        that were not asked for everything."""
        for robot, size in sizes.items():
            about = places.get(robot)
            self._knowledge.record_payload(
                robot,
                asked[robot],
                size,
                EPOCH_NS,  # A drive is shorter than a receipt lives.
                focused=about is not None and bool(about.places),
                objects_only=about is not None and not about.places,
            )

    def _decide(self, number: int, frame: int) -> Decision:
        drive, known = self._drive, self._knowledge
        now_s = self._now_s = number / drive.world.rate_hz
        seen = snapshot(drive.ego, drive.heard(frame, ALGORITHMS), self._known_bps(now_s))
        now_ns = EPOCH_NS + round(now_s * 1e9)
        scene = analyze(seen, known)
        if not self._how.validated:
            return as_proposed(self._policy, scene, known)
        return plan(seen, scene, self._policy, known, self._decision, number, now_ns)


def _policy(name: str, seed: int) -> Policy:
    if name == RANDOM:
        return AnyAssignments(seed)
    if name == TRAINED:
        return AdvisedAtOnce(_trained(), "short")
    if name == GUESSED:
        return AdvisedAtOnce(Guessing(seed), "short")
    return make_policy(name, ALGORITHMS)


@cache
def _trained() -> Model:
    """One a process, which ends with it."""
    return Model(DEFAULT_MODEL, ResultStore(KEPT, MADE_FROM), ADAPTER)


class Guessing:
    """Gives any answer that the schema allows, all equally likely: the control of a model."""

    name = "guesses"

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def ask(self, prompt: Prompt) -> Answer:
        """See `Adviser`."""
        return Answer(
            json.dumps(self._rng.choice(json.loads(prompt.schema)["enum"]).item()), "", 0.0
        )


class AnyAssignments:
    """Any robots, any algorithms, any rates, as many as the link carries: what a choice of
    assignments must beat."""

    name = RANDOM

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        """Robots join in any order with any option, while all budgets last."""
        mixes = Mixes(Scorer(scene, knowledge))
        chosen: list[Assignment] = []
        for place in self._rng.permutation(len(scene.candidates)):
            options = mixes.options_of(scene.candidates[place].robot)
            for number in self._rng.permutation(len(options))[:1]:
                score = mixes.score([*chosen, options[number]])
                if score is not None and mixes.carries(score):
                    chosen.append(options[number])
        names: Sequence[str] = [scene.ego.robot, *(one.robot for one in chosen)]
        return Proposal(tuple(names), MIXED, "chance", "policy", assignments=tuple(chosen))
