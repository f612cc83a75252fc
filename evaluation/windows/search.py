"""The oracle: the best choice, found by measuring.

With EXHAUSTIVE candidates at most (six robots) every set of them with every algorithm is measured:
2^N choices each. Beyond, the search measures, for every algorithm, sets that grow in the order of
coverage gained (STEPS members), whatever policies chose, and from the best of them on its
neighbours: with one robot more or less of the NEAREST, or with another algorithm, as long as that
helps, MOVES times at most. What it finds is a lower bound of the best.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

from ego_agent.greedy import grow
from ego_agent.knowledge import Knowledge
from ego_agent.model import UnifiedScene
from ego_agent.scoring import Scorer
from evaluation.windows.choice import ALONE, Choice, Outcome
from evaluation.windows.measure import Window, candidates_of

EXHAUSTIVE = 5
STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
NEAREST = 10
MOVES = 2


def every_choice(candidates: Sequence[str], algorithms: Sequence[str]) -> Iterator[Choice]:
    """All sets of candidates with all algorithms; the ego alone once."""
    yield Choice((), ALONE)
    for size in range(1, len(candidates) + 1):
        for members in combinations(sorted(candidates), size):
            for algorithm in algorithms:
                yield Choice(members, algorithm)


def explore(
    window: Window, scene: UnifiedScene, knowledge: Knowledge, wanted: Iterable[Choice]
) -> None:
    """Measures the wanted choices and those among which the oracle finds its own; all are in
    `window.outcomes` then."""
    for choice in wanted:
        window.outcome(choice)
    candidates = candidates_of(scene)
    if len(candidates) <= EXHAUSTIVE:
        for choice in every_choice(candidates, knowledge.algorithms):
            window.outcome(choice)
        return
    for choice in _growing(scene, knowledge):
        window.outcome(choice)
    _climb(window, candidates, knowledge)


def best(outcomes: dict[Choice, Outcome], knowledge: Knowledge, capacity_bps: float) -> Choice:
    """The choice of the greatest AP@0.7 - lambda C among those that the link carries; the fewer
    bytes where several are equal."""
    objective = knowledge.objective
    feasible = [c for c, outcome in outcomes.items() if outcome.fits(objective, capacity_bps)]
    return min(
        feasible,
        key=lambda c: (-outcomes[c].value(objective), outcomes[c].bytes_per_frame, c),
    )


def held_out_regret(
    outcomes: dict[Choice, Outcome], choice: Choice, knowledge: Knowledge, capacity_bps: float
) -> float:
    """The regret against an oracle that looks at one half of the frames and is judged by the other,
    the mean of both ways.

    The best of many choices on few frames is partly luck; here luck does not count.
    """
    objective = knowledge.objective
    feasible = [one for one in outcomes.values() if one.fits(objective, capacity_bps)]
    regrets = []
    for half in (0, 1):
        top = max(feasible, key=lambda one: one.half_value(objective, half))
        other = 1 - half
        regrets.append(
            top.half_value(objective, other) - outcomes[choice].half_value(objective, other)
        )
    return sum(regrets) / 2


def _growing(scene: UnifiedScene, knowledge: Knowledge) -> Iterator[Choice]:
    """The ego alone, and growing sets with every algorithm, of whatever cost."""
    yield Choice((), ALONE)
    scorer = Scorer(scene, knowledge, budget_bytes=1 << 60)
    candidates = candidates_of(scene)
    order: list[str] = []
    for score in grow(scorer, scene.candidates, knowledge.algorithms[0], by_byte=False):
        order += [robot for robot in score.participants if robot not in order]
    order += [robot for robot in candidates if robot not in order]
    sizes = sorted({*(step for step in STEPS if step < len(order)), len(order)})
    for size in sizes:
        for algorithm in knowledge.algorithms:
            yield Choice(tuple(sorted(order[:size])), algorithm)


def _climb(window: Window, candidates: Sequence[str], knowledge: Knowledge) -> None:
    capacity_bps = window.scenario.capacity_bps(window.index)
    top = best(window.outcomes, knowledge, capacity_bps)
    for _ in range(MOVES):
        for choice in _neighbours(top, candidates[:NEAREST], knowledge.algorithms):
            window.outcome(choice)
        better = best(window.outcomes, knowledge, capacity_bps)
        if better == top:
            return
        top = better


def _neighbours(
    choice: Choice, candidates: Sequence[str], algorithms: Sequence[str]
) -> Iterator[Choice]:
    members = set(choice.participants)
    algorithm = choice.algorithm or algorithms[0]
    for robot in candidates:
        changed = members ^ {robot}
        yield Choice(tuple(sorted(changed)), algorithm if changed else ALONE)
    if members:
        for other in algorithms:
            yield Choice(choice.participants, other)
