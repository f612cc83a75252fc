"""A shadow replay: the decisions of the last minute, made again without and with an intent."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.intents.bind import (
    NOTHING_KNOWN,
    Known,
    bound_objective,
    bound_scene,
    inside,
    placed,
)
from ego_agent.plan.intents.combine import Standing
from ego_agent.plan.intents.obey import plan_obeying
from ego_agent.plan.policies.base import Policy
from swarm.messages import Decision, Effect, Expected

SPAN_S = 60.0
EVERY_S = 3.0
"""From one kept snapshot to the next."""
BUDGET_S = 2.0
"""How long a replay may take; what is older is left out then."""


@dataclass(frozen=True, slots=True)
class _Moment:
    at_s: float
    snapshot: Snapshot
    known: Known


class LastMinute:
    """Keeps what a replay needs. `note` belongs to the control cycle, `effect` may be called from
    any thread. Times are `time.monotonic()` seconds."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._moments: deque[_Moment] = deque(maxlen=round(SPAN_S / EVERY_S))
        self._newest: _Moment | None = None

    def note(self, snapshot: Snapshot, now_s: float, known: Known = NOTHING_KNOWN) -> None:
        """Keeps a snapshot until the next one, and for a minute where none was kept of late."""
        with self._lock:
            self._newest = _Moment(now_s, snapshot, known)
            if not self._moments or now_s - self._moments[-1].at_s >= EVERY_S:
                self._moments.append(self._newest)

    def effect(
        self,
        knowledge: Knowledge,
        objective: Objective,
        before: tuple[Standing, Policy],
        after: tuple[Standing, Policy],
        now_s: float,
    ) -> Effect:
        """What changes from one standing to another, each with the policy that decides then.

        Every decision is made anew, without hysteresis. `objective`: without any wish.
        """
        with self._lock:
            kept = [*self._moments]
            if self._newest is not None and self._newest is not kept[-1]:
                kept.append(self._newest)
        moments = [m for m in kept if now_s - m.at_s <= SPAN_S + EVERY_S]
        until_s = time.monotonic() + BUDGET_S
        sums = (_Sum(), _Sum())
        span_s = 0.0
        for moment in reversed(moments):
            if sums[0].count and time.monotonic() > until_s:
                break
            span_s = now_s - moment.at_s
            scene = analyze(moment.snapshot, knowledge.aiming_at(objective))
            for total, (wishes, policy) in zip(sums, (before, after), strict=True):
                aimed = knowledge.aiming_at(bound_objective(objective, wishes))
                bound = bound_scene(scene, wishes, moment.known)
                now_ns = moment.snapshot.now_ns
                decision = plan_obeying(
                    moment.snapshot, bound, policy, aimed, None, 0, now_ns, wishes
                )
                total.add(decision, scene, knowledge.aiming_at(objective), after[0])
        return Effect(
            decisions=sums[0].count,
            span_s=round(span_s, 1),
            policy=after[1].name,
            before=sums[0].mean(),
            after=sums[1].mean(),
            nobody=sums[0].participants > 0 and sums[1].participants == 0,
        )


class _Sum:
    """Adds decisions up."""

    def __init__(self) -> None:
        self.count = 0
        self.participants = 0
        self._robots: Counter[str] = Counter()
        self._bytes_s = 0.0
        self._quality = 0.0
        self._seen: dict[str, list[float]] = {}

    def add(
        self, decision: Decision, scene: UnifiedScene, knowledge: Knowledge, wishes: Standing
    ) -> None:
        """`scene` and `knowledge` without any wish; `wishes`: whose places are looked at."""
        others = decision.participants[1:]
        at = Scorer(scene, knowledge).at_rate(decision.rate_hz)
        self.count += 1
        self.participants += len(others)
        self._robots.update(others)
        self._bytes_s += decision.cost_bytes * decision.rate_hz
        self._quality += _score(at, decision).quality
        for name, share in _seen(scene, others, wishes):
            self._seen.setdefault(name, []).append(share)

    def mean(self) -> Expected | None:
        """None where nothing was added."""
        if not self.count:
            return None

        def share(total: float) -> float:
            return round(total / self.count, 4)

        return Expected(
            participants=share(self.participants),
            robots={robot: share(times) for robot, times in sorted(self._robots.items())},
            bytes_s=share(self._bytes_s),
            quality=share(self._quality),
            seen={name: round(float(np.mean(s)), 4) for name, s in self._seen.items()},
        )


def _score(at: Scorer, decision: Decision) -> Score:
    """A decision's, by a scorer at its pace."""
    if decision.assignments:
        return Mixes(at).score_able(decision.assignments)
    return at.score(decision.participants[1:], decision.algorithm)


def _seen(
    scene: UnifiedScene, others: tuple[str, ...], wishes: Standing
) -> list[tuple[str, float]]:
    """Of each place, what the ego and the others see of it, in the share of what all could."""
    every = [scene.ego, *scene.candidates, *scene.unheard]
    everything = np.stack([candidate.area for candidate in every])
    chosen = [c.robot in others for c in every]
    chosen[0] = True
    found = []
    for name, wished in wishes.focus.items():
        cells = inside(scene, placed(name, wished))
        could = int((everything.any(axis=0) & cells).sum())
        if could:
            found.append((name, float((everything[chosen].any(axis=0) & cells).sum()) / could))
    return found
