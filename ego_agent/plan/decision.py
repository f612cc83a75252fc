"""Plan: a policy proposes, validation decides. There is a valid decision in every cycle."""

from __future__ import annotations

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.plan.choices.hysteresis import held
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.validation import bounded, make_decision, validate
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.policies.coverage import Coverage
from swarm.messages import Decision

_FALLBACK = Coverage()


def plan(
    snapshot: Snapshot,
    scene: UnifiedScene,
    policy: Policy,
    knowledge: Knowledge,
    previous: Decision | None,
    cycle: int,
    now_ns: int,
) -> Decision:
    """The decision of this cycle; always a valid one, whatever the policy does.

    The policy's proposal where it can be used or repaired; else what `coverage` proposes, with
    source `fallback`; else the ego alone. `Decision.policy` names the policy that was asked, and
    `repairs` tells the whole story.
    """
    decision = _decided(scene, policy, knowledge, previous, cycle, now_ns)
    return held(decision, previous, now_ns)


def _decided(
    scene: UnifiedScene,
    policy: Policy,
    knowledge: Knowledge,
    previous: Decision | None,
    cycle: int,
    now_ns: int,
) -> Decision:
    repairs: tuple[str, ...] = ()
    for proposer in (policy, _FALLBACK):
        decision, found = _ask(proposer, scene, knowledge, previous, policy.name, cycle, now_ns)
        if decision is None:
            repairs = (*repairs, *found)
        elif proposer is policy:
            return decision
        else:
            return msgspec.structs.replace(
                decision, source="fallback", repairs=bounded((*repairs, *found))
            )
    scorer = Scorer(scene, knowledge)
    return make_decision(
        scorer,
        scorer.score((), knowledge.best_algorithm()),
        reason="Nothing else could be decided: the ego goes on alone.",
        source="fallback",
        repairs=repairs,
        policy=policy.name,
        cycle=cycle,
        now_ns=now_ns,
    )


def _ask(
    proposer: Policy,
    scene: UnifiedScene,
    knowledge: Knowledge,
    previous: Decision | None,
    asked: str,
    cycle: int,
    now_ns: int,
) -> tuple[Decision | None, tuple[str, ...]]:
    """One policy's proposal, validated; an exception refuses it like any other fault."""
    try:
        proposal = proposer.propose(scene, knowledge, previous)
        return validate(proposal, scene, knowledge, policy=asked, cycle=cycle, now_ns=now_ns)
    except Exception as error:  # a policy may be anyone's: no fault of it ends the loop
        return None, bounded(
            [f"refused: {proposer.name} failed with {type(error).__name__}: {error}"]
        )
