"""What of the chosen robots arrives, and what the ego says where nothing does.

A decision predicts; only what arrives is perceived. An ego that hears nobody, or gets nothing of
what it chose, says so in the next cycle.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import TypeVar

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.knowledge.tally import Tally
from ego_agent.plan.choices.scoring import Scorer
from swarm.messages import Decision
from swarm.messages.ego import MAX_NAMED

V = TypeVar("V")


class Arrivals:
    """Counts the cycles in which nothing of a chosen robot came; used by the control cycle."""

    def __init__(self) -> None:
        self._nothing: Counter[str] = Counter()
        """Cycles in a row in which a robot was asked and nothing came in time."""
        self._why: dict[str, str] = {}
        self._alone = 0
        """Cycles in a row in which robots were asked and nothing at all came in time."""

    def take(self, decision: Decision, tally: Tally) -> None:
        """Takes what came while a decision was in force."""
        asked: dict[str, Counter[str]] = {}
        for (robot, kind), count in tally.missing.items():
            asked.setdefault(robot, Counter())[kind] += count
        for robot in {*self._nothing, *asked, *tally.in_time}:
            if tally.in_time[robot] or robot not in decision.participants:
                self._nothing.pop(robot, None)
                self._why.pop(robot, None)
            elif robot in asked:
                self._nothing[robot] += 1
                ((self._why[robot], _),) = asked[robot].most_common(1)
        if sum(tally.in_time.values()) or len(decision.participants) == 1:
            self._alone = 0
        elif tally.missing or not tally.fused:  # else nobody was due
            self._alone += 1

    def told(
        self,
        decision: Decision,
        snapshot: Snapshot,
        scene: UnifiedScene | None,
        knowledge: Knowledge,
        narrow: str = "",
    ) -> Decision:
        """The decision with what keeps robots out of it and from arriving. Where nothing arrives,
        its quality is the ego's own. `narrow`: that the link is too narrow, in words."""
        chosen = [r for r in decision.participants if r != decision.ego]
        silent = {
            robot: f"nothing of it has arrived for {_cycles(self._nothing[robot])} "
            f"({self._why[robot]})"
            for robot in chosen
            if self._nothing[robot]
        }
        blind = self._blind(decision, scene, chosen)
        if blind and narrow:
            blind = f"{blind}; {narrow}"
        said = f"BLIND: {blind}." if blind else f"{narrow}." if narrow else ""
        quality = decision.quality
        if scene is not None and blind and chosen:
            alone = Scorer(scene, knowledge).score((), decision.algorithm)
            quality = min(quality, alone.quality)
        ages = {
            robot: round(max(0.0, view.beacon_age_s), 3)
            for robot, view in snapshot.robots.items()
            if math.isfinite(view.beacon_age_s)
        }
        return msgspec.structs.replace(
            decision,
            reason=f"{decision.reason} {said}" if said else decision.reason,
            quality=quality,
            blind=blind,
            excluded=bounded(scene.excluded if scene else {}),
            silent=bounded(silent),
            ages_s=bounded(ages),
        )

    def _blind(self, decision: Decision, scene: UnifiedScene | None, chosen: list[str]) -> str:
        if scene is None:
            return ""
        if trouble := scene.excluded.get(decision.ego):
            return f"the ego does not see: {trouble}"
        unheard = len(scene.unheard) + scene.unknown
        if unheard and not scene.candidates:
            first = [f" ({robot}: {why})" for robot, why in scene.excluded.items()][:1]
            return (
                f"none of {unheard} living robots can be relied on, so the quality is not known"
                + "".join(first)
            )
        if chosen and self._alone:
            kinds = Counter(self._why[robot] for robot in chosen if robot in self._why)
            why = ", ".join(sorted(kinds)) or "no frame was fused"
            return f"nothing of what was chosen has arrived for {_cycles(self._alone)} ({why})"
        return ""


def _cycles(count: int) -> str:
    return f"{count} cycle" + ("s" if count != 1 else "")


def bounded(values: Mapping[str, V]) -> dict[str, V]:
    """What is told of robots by name, of as many as a message may name."""
    return dict(sorted(values.items())[:MAX_NAMED])
