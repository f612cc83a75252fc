"""Which intents a decision obeys, and what each one did to it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.intents.bind import inside, placed
from ego_agent.plan.intents.combine import Standing, Wished, name_of
from swarm.intent_words import in_words, sentence
from swarm.messages import Decision, IntentInForce, IntentTold


def told(
    decision: Decision, scene: UnifiedScene | None, wishes: Standing
) -> tuple[IntentTold, ...]:
    """The intents in force, oldest first; `scene`: the bound one, None where there was none."""
    return tuple(
        IntentTold(
            number=one.number,
            operator=one.operator,
            since_ns=one.since_ns,
            until=one.intent.until,
            says=in_words(one.intent),
            bound=(
                *map(sentence, () if scene is None else _bound(one, decision, scene, wishes)),
                *map(sentence, wishes.overruled.get(one.number, ())),
            ),
        )
        for one in wishes.intents
    )


def _bound(
    one: IntentInForce, decision: Decision, scene: UnifiedScene, wishes: Standing
) -> Iterator[str]:
    name = name_of(one)
    gone = [c.robot for c in scene.left_out if scene.excluded[c.robot].endswith(name)]
    if gone:
        yield f"{', '.join(sorted(gone))} left out"
    if _is_of(wishes.q_min, one):
        assert wishes.q_min is not None
        reached = decision.quality >= wishes.q_min.value
        yield (
            f"Q {decision.quality:.2f} {'reaches' if reached else 'is the best, below'} "
            f"{wishes.q_min.value:g}"
        )
    if _is_of(wishes.link_share, one):
        assert wishes.link_share is not None
        used = decision.cost_bytes * 8.0 * decision.rate_hz / 1e6
        most = wishes.link_share.value * decision.capacity_bps / 1e6
        yield f"observations take {used:.2f} of at most {most:.2f} Mbit/s"
    if _is_of(wishes.policy, one):
        yield f"{decision.policy} decides"
    for place, wished in wishes.focus.items():
        if _is_of(wished, one):
            cells = inside(scene, placed(place, wished))
            if not np.any(cells):
                yield f"{place} lies outside of what counts around {decision.ego}"
    if asked := sorted(wishes.prefer & set(decision.participants) & set(one.intent.prefer)):
        yield f"{', '.join(asked)} preferred"


def _is_of(wished: Wished[object] | None, one: IntentInForce) -> bool:
    return wished is not None and wished.by is one
