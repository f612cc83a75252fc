"""Decisions that obey intents, whatever the policy."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.plan.choices.hysteresis import held
from ego_agent.plan.choices.options import Compared
from ego_agent.plan.choices.validation import bounded
from ego_agent.plan.decision import plan
from ego_agent.plan.intents.combine import Standing, name_of
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.policies.coverage import Coverage
from swarm.messages import Decision

_RESCUE = Coverage()


def plan_obeying(
    snapshot: Snapshot,
    scene: UnifiedScene,
    policy: Policy,
    knowledge: Knowledge,
    previous: Decision | None,
    cycle: int,
    now_ns: int,
    wishes: Standing,
    on_fault: Callable[[str], None] = lambda why: None,
    on_compared: Callable[[Compared], None] = lambda compared: None,
) -> Decision:
    """The decision of this cycle, for a scene and an objective that the wishes have bound.

    Such a scene holds nobody who is left out, and such an objective the share of the link, which
    validation keeps. A Q_min that is wished is kept here: where the policy misses it, or keeps a
    decision that does, and `coverage` reaches it, `coverage` decides. `on_fault` and `on_compared`
    are those of `plan`.
    """
    decision = plan(
        snapshot, scene, policy, knowledge, previous, cycle, now_ns, on_fault, on_compared
    )
    wished = wishes.q_min
    if wished is None or decision.quality >= wished.value:
        return decision
    # Without hysteresis and rarer contributions, both of which may cost a little quality.
    strict = knowledge.aiming_at(msgspec.structs.replace(knowledge.objective, rarer_hz=()))
    rescue = plan(snapshot, scene, _RESCUE, strict, None, cycle, now_ns)
    if rescue.quality < wished.value:
        return decision
    story = (
        f"took what coverage proposes: {name_of(wished.by)} asks for Q_min {wished.value:g}, "
        f"{policy.name} reaches {decision.quality:.2f}"
    )
    taken = msgspec.structs.replace(
        rescue,
        policy=decision.policy,
        source="policy" if policy.name == _RESCUE.name else "fallback",
        repairs=bounded((*decision.repairs, story)),
        advice=decision.advice,
    )
    return held(taken, previous, now_ns)
