"""What the ego needs of its cell to reach Q_min: the word to the network controller.

The cheapest decision that reaches Q_min is looked for as if the cell had no limit; the robots' own
links keep theirs, as no wider cell would help there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.mixes import Mixes, burst
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.control_budget import Wish
from swarm.messages import Decision, NetDemand

UNLIMITED_BYTES = 2**62
"""A budget that nobody exceeds, and that sums of sizes can be compared with in 64 bits."""

ROUNDING = 1e-9
"""Sums in another order differ by less than this."""


STEP = 0.7
NARROWER = 8
"""Each cell that is tried is so much narrower than the one before, so often at most."""


@dataclass(frozen=True, slots=True)
class Need:
    """What the cheapest decision that reaches Q_min takes."""

    bytes_s: int
    """Capacity that makes it feasible, headroom included; 0 where the ego needs nobody, or where
    nothing reaches Q_min."""
    possible: bool
    """Some decision reaches Q_min."""
    fits: bool
    """C(t) carries it."""


def need(scene: UnifiedScene, knowledge: Knowledge) -> Need:
    """What this scene takes to reach Q_min. The best of the greedy orders, so not always the very
    cheapest; but `coverage` finds it too: it reaches Q_min on a link of 8 * `bytes_s`."""
    # Lateness may be the narrow cell's own doing: it says nothing about a wider one.
    scorer = Scorer(scene, knowledge, budget_bytes=UNLIMITED_BYTES, hopes=True)
    cost = _cheapest(scorer)
    if cost is None:
        return Need(0, possible=False, fits=False)
    objective = knowledge.objective
    bytes_s = math.ceil(cost * objective.rate_hz / objective.headroom)
    while objective.budget_bytes(8.0 * bytes_s) < cost:
        bytes_s += 1  # rounding of the budget
    if cost and objective.rarer_hz and knowledge.mixable:
        bytes_s = _with_assignments(scorer, bytes_s)
        return Need(bytes_s, possible=True, fits=8 * bytes_s <= scene.capacity_bps)
    return Need(bytes_s, possible=True, fits=cost <= objective.budget_bytes(scene.capacity_bps))


def _with_assignments(scorer: Scorer, bytes_s: int) -> int:
    """The same where each robot may have an algorithm and a rate of its own: the narrowest cell of
    a few on which such a choice reaches Q_min, mean and burst; `bytes_s` where none does."""
    found = bytes_s
    for _ in range(NARROWER):
        # Bytes cost more on a narrower cell, so another choice may be made there.
        scene = replace(scorer.scene, capacity_bps=math.ceil(found * STEP) * 8.0)
        mixes = Mixes(Scorer(scene, scorer.knowledge, hopes=True))
        q_min = scorer.objective.q_min
        grown = (mixes.grow(by_byte=by_byte) for by_byte in (True, False))
        if not any(_reached(score.quality, q_min) for score in grown):
            break
        found = math.ceil(found * STEP)
    return found


def _cheapest(scorer: Scorer) -> int | None:
    """Bytes a frame of the cheapest set that reaches Q_min; None where none does."""
    knowledge = scorer.knowledge
    if _reached(scorer.score((), knowledge.best_algorithm()).quality, scorer.objective.q_min):
        return 0
    cost: int | None = None
    for algorithm in knowledge.algorithms:
        able = [c.robot for c in scorer.scene.candidates if scorer.can(c.robot, algorithm)]
        if not _reached(scorer.score(able, algorithm).quality, scorer.objective.q_min):
            continue
        for by_byte in (True, False):
            for score in grow(scorer, scorer.scene.candidates, algorithm, by_byte=by_byte):
                if _reached(score.quality, scorer.objective.q_min):
                    cost = score.cost_bytes
                    scorer.budget_bytes = cost - 1  # only what is cheaper is of interest now
                    break
    return cost


def _reached(quality: float, q_min: float) -> bool:
    return quality >= q_min - ROUNDING


SETTLED_S = 5.0
"""A link that is good for less than this has not become good: the time goes on."""


class DemandMeter:
    """Says in every cycle what is needed, and for how long the link has kept it from the ego."""

    def __init__(self) -> None:
        self._below_since: float | None = None
        self._good_since: float | None = None

    def take(
        self,
        scene: UnifiedScene,
        knowledge: Knowledge,
        decision: Decision,
        *,
        sent_ns: int,
        now_s: float,
        steady_ns: int = 0,
        control: Wish | None = None,
    ) -> NetDemand:
        """The message of a cycle whose decision was made at `now_s`, `time.monotonic()` seconds."""
        found = need(scene, knowledge)
        objective = knowledge.objective
        enough = found.fits or _reached(decision.quality, objective.q_min)
        reachable = found.possible and enough and not decision.blind
        unheard = bool(scene.unheard or scene.unknown)
        if not found.possible and not unheard:
            self._below_since = self._good_since = None
        elif reachable:
            self._good_since = now_s if self._good_since is None else self._good_since
            if now_s - self._good_since >= SETTLED_S:
                self._below_since = None
        else:
            self._good_since = None
            self._below_since = now_s if self._below_since is None else self._below_since
        since = now_s if reachable or self._below_since is None else self._below_since
        return NetDemand(
            ego=decision.ego,
            cycle=decision.cycle,
            sent_ns=sent_ns,
            needed_bytes_s=found.bytes_s,
            possible=found.possible,
            reachable=reachable,
            unreachable_s=max(0.0, now_s - since),
            quality=decision.quality,
            q_min=objective.q_min,
            capacity_bps=round(scene.capacity_bps),
            steady_ns=steady_ns,
            control_bps=control.each_bps if control else 0,
            fewer_bps=control.fewer_bps if control else {},
            mean_bytes_s=round(decision.cost_bytes * decision.rate_hz),
            burst_bytes=_burst_bytes(scene, decision),
        )


def _burst_bytes(scene: UnifiedScene, decision: Decision) -> int:
    """Bytes of the largest fused frame of a decision, by what its robots announce."""
    if not decision.assignments:
        return decision.cost_bytes
    by_robot = {candidate.robot: candidate for candidate in scene.candidates}
    sizes, places = {}, {}
    for one in decision.assignments:
        candidate = by_robot.get(one.robot)
        sizes[one.robot] = candidate.sizes.get(one.algorithm, 0) if candidate else 0
        if candidate and one.algorithm in candidate.sizes:
            places[one.robot] = candidate.places_size(one.algorithm)
    return burst(decision.assignments, decision.rate_hz, sizes, places)
