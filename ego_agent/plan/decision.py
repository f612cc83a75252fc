"""Plan: a policy proposes, validation decides. There is a valid decision in every cycle."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.plan.assign import assigned
from ego_agent.plan.choices.hysteresis import held
from ego_agent.plan.choices.options import Compared
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.validation import Unusable, bounded, make_decision, validate
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
    on_fault: Callable[[str], None] = lambda why: None,
    on_compared: Callable[[Compared], None] = lambda compared: None,
) -> Decision:
    """The decision of this cycle; always a valid one, whatever the policy does.

    The policy's proposal where it can be used or repaired; else what `coverage` proposes, with
    source `fallback`; else the ego alone. `Decision.policy` names the policy that was asked, and
    `repairs` tells the whole story. `on_fault` hears of a policy that raises an exception;
    `on_compared` of what it was chosen from, where the policy says so.
    """
    decision = _decided(scene, policy, knowledge, previous, cycle, now_ns, on_fault, on_compared)
    return held(decision, previous, now_ns)


def _decided(
    scene: UnifiedScene,
    policy: Policy,
    knowledge: Knowledge,
    previous: Decision | None,
    cycle: int,
    now_ns: int,
    on_fault: Callable[[str], None],
    on_compared: Callable[[Compared], None],
) -> Decision:
    repairs: tuple[str, ...] = ()
    for proposer in (policy, _FALLBACK):
        try:
            proposal = proposer.propose(scene, knowledge, previous)
            found = validate(
                proposal, scene, knowledge, policy=policy.name, cycle=cycle, now_ns=now_ns
            )
            if isinstance(found, Decision) and isinstance(proposal.compared, Compared):
                on_compared(proposal.compared)
        except Exception as error:  # a policy may be anyone's: no fault of it ends the loop
            found = Unusable(f"{proposer.name} failed with {type(error).__name__}: {error}")
            on_fault(found.why)
        if isinstance(found, Unusable):
            repairs = (*repairs, *found.repairs)
            continue
        if proposer is not policy:
            found = msgspec.structs.replace(
                found, source="fallback", repairs=bounded((*repairs, *found.repairs))
            )
        if proposal.assignments:
            return found
        return assigned(found, scene, knowledge, previous)
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


def alone(snapshot: Snapshot, knowledge: Knowledge, policy: str, reason: str) -> Decision:
    """The decision that always holds: the ego alone costs nothing and needs nobody."""
    return Decision(
        ego=snapshot.ego,
        cycle=snapshot.cycle,
        decided_ns=snapshot.now_ns,
        participants=(snapshot.ego,),
        algorithm=knowledge.best_algorithm(),
        reason=reason,
        source="fallback",
        policy=policy,
        valid=snapshot.robots[snapshot.ego].beacon is not None,
        rate_hz=knowledge.objective.rate_hz,
        capacity_bps=max(1.0, snapshot.capacity_bps),
    )
