"""What every policy decides in the windows of a scenario, from what an ego would know."""

from __future__ import annotations

import copy
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.policies.random_choice import Chance
from ego_agent.plan.policies.registry import make_policy
from research.evaluation.windows.announcements import EPOCH_NS, Announced, snapshot
from research.evaluation.windows.choice import Choice
from research.evaluation.windows.measure import candidates_of
from research.evaluation.windows.placed import Placed, learnt
from research.evaluation.windows.scenarios import Scenario
from swarm.errors import EvaluationError
from swarm.messages import Decision

BLIND, STATIC = ("random", "rules"), "static-"
"""Policies whose proposals are measured as they are, and what names of others of them begin with:
the baselines of the paper know no validation. All others are validated, as an ego would."""


def is_blind(policy: str) -> bool:
    """Whether that policy's proposals are measured as they are."""
    return policy in BLIND or policy.startswith(STATIC)


@runtime_checkable
class Waiting(Protocol):
    """A policy that knows how long it has waited for others, also where answers were kept."""

    @property
    def waited_s(self) -> float:
        """So far."""
        ...

    @property
    def answered(self) -> bool:
        """Whether the newest question had an answer, of whatever use; true before any."""
        ...


@dataclass(frozen=True, slots=True)
class Decided:
    """One policy's decision for one window."""

    scenario: str
    window: int
    robots: tuple[str, ...]
    ego: str
    in_range: tuple[str, ...]
    """Who could take part, apart from the ego."""
    policy: str
    choice: Choice
    predicted_bytes: int
    """C(P, a) by the announced sizes."""
    reason: str
    source: str
    decision_s: float
    """From the snapshot to the decision; of a language model, until its answer."""
    repairs: tuple[str, ...] = ()
    answered: bool | None = None
    """Whether the language model that was asked, if one was, has answered."""


def decisions(
    scenario: Scenario,
    heard: Sequence[Announced],
    knowledge: Knowledge,
    policy: Policy,
    placed: Sequence[Placed] = (),
) -> list[Decided]:
    """The decisions of one policy in all windows, one after the other: it knows the one before.

    `heard`: what the ego had heard at the beginning of each window. `placed`: whom it could place
    before each; without, it has learnt nothing of that. Raises EvaluationError for a
    policy that fails: an ego would go on with `coverage`, whose results are not the policy's.
    """

    def failed(why: str) -> None:
        raise EvaluationError(f"in {scenario.name}: {why}")

    robots = tuple(heard[0])
    ego = robots[scenario.ego]
    blind = is_blind(policy.name)
    previous: Decision | None = None
    found = []
    for window, messages in enumerate(heard):
        begun, waited_s = time.perf_counter(), _waited_s(policy)
        known = having_placed(knowledge, placed, window)
        seen = snapshot(ego, messages, scenario.known_bps(window))
        scene = analyze(seen, known)
        if blind:
            decision = as_proposed(policy, scene, known)
        else:
            decision = plan(seen, scene, policy, known, previous, window, EPOCH_NS, failed)
        took_s = time.perf_counter() - begun
        if isinstance(policy, Waiting):
            took_s = policy.waited_s - waited_s
        answered = policy.answered if isinstance(policy, Waiting) else None
        previous = decision
        found.append(
            Decided(
                scenario=scenario.name,
                window=window,
                robots=robots,
                ego=ego,
                in_range=candidates_of(scene),
                policy=policy.name,
                choice=Choice.of(decision.participants, decision.algorithm, ego),
                predicted_bytes=decision.cost_bytes,
                reason=decision.reason,
                source=decision.source,
                decision_s=took_s,
                repairs=decision.repairs,
                answered=answered,
            )
        )
    return found


def having_placed(knowledge: Knowledge, placed: Sequence[Placed], window: int) -> Knowledge:
    """What an ego knows that could place them before that window; `placed`: of each window, or of
    none."""
    known = copy.copy(knowledge)
    known.placing = learnt(placed[window] if placed else {})
    return known


def policy_of(name: str, scenario: Scenario, knowledge: Knowledge) -> Policy:
    """A new policy of that name; chance draws by the scenario's seed. Raises DecisionError for an
    unknown one, and EvaluationError for one that needs a gateway."""
    if name == "llm":
        raise EvaluationError("policy 'llm' needs a language model: name it with --models")
    if name == "random":
        return Chance(seed=scenario.seed)
    return make_policy(name, knowledge.algorithms)


def _waited_s(policy: Policy) -> float:
    return policy.waited_s if isinstance(policy, Waiting) else 0.0


def as_proposed(policy: Policy, scene: UnifiedScene, knowledge: Knowledge) -> Decision:
    """The decision that a proposal is where nobody checks it."""
    proposal = policy.propose(scene, knowledge, None)
    sizes = {candidate.robot: candidate.sizes for candidate in scene.candidates}
    cost = sum(
        sizes[robot].get(proposal.algorithm, 0) for robot in proposal.participants if robot in sizes
    )
    return Decision(
        ego=scene.ego.robot,
        cycle=0,
        decided_ns=EPOCH_NS,
        participants=proposal.participants,
        algorithm=proposal.algorithm,
        reason=proposal.reason,
        source=proposal.source,
        policy=policy.name,
        valid=True,
        cost_bytes=cost,
    )
