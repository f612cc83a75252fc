"""The oracle: the best choice, found by measuring.

With EXHAUSTIVE candidates at most (six robots) every set of them with every algorithm is measured:
2^N choices each. Beyond, the search measures, for every algorithm, sets that grow in the order of
coverage gained (STEPS members), whatever policies chose, and from the best of them on its
neighbours: with one robot more or less of the NEAREST, or with another algorithm, as long as that
helps, MOVES times at most. What it finds is a lower bound of the best. The oracle knows no Q_min.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.scoring import Scorer
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.measure import Window, candidates_of

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
) -> dict[Choice, Outcome]:
    """The outcomes of the wanted choices, and of those among which the oracle finds its own.

    What else is known of the window plays no part, so that equal calls have equal results.
    """
    candidates, algorithms = candidates_of(scene), knowledge.algorithms
    considered = {choice: window.outcome(choice) for choice in sorted(set(wanted))}
    if len(candidates) <= EXHAUSTIVE:
        for choice in every_choice(candidates, algorithms):
            considered[choice] = window.outcome(choice)
        return considered
    for choice in _growing(scene, knowledge):
        considered[choice] = window.outcome(choice)
    capacity_bps = window.scenario.capacity_bps(window.index)
    top = best(considered, capacity_bps, knowledge)
    for _ in range(MOVES):
        for choice in _neighbours(top, candidates[:NEAREST], algorithms):
            considered[choice] = window.outcome(choice)
        better = best(considered, capacity_bps, knowledge)
        if better == top:
            break
        top = better
    return considered


def best(considered: Mapping[Choice, Outcome], capacity_bps: float, knowledge: Knowledge) -> Choice:
    """The choice of the greatest delivered AP@0.7 - lambda C among those that the link carries and
    whose algorithms may be used; the fewer bytes where several are equal."""
    objective = knowledge.objective
    return min(
        _possible(considered, capacity_bps, knowledge),
        key=lambda c: (-considered[c].value(objective), considered[c].bytes_per_frame, c),
    )


def held_out_regret(
    considered: Mapping[Choice, Outcome], value: Outcome, capacity_bps: float, knowledge: Knowledge
) -> float | None:
    """The regret of an outcome against an oracle that looks at one half of the frames and is judged
    by the other, the mean of both ways; None where a half holds no true box.

    The best of many choices on few frames is partly luck; here luck does not count.
    """
    if value.arrived.halves is None:
        return None
    objective = knowledge.objective
    possible = _possible(considered, capacity_bps, knowledge)
    regrets = []
    for half in (0, 1):
        top = min(
            possible,
            key=lambda c, half=half: (  # type: ignore[misc]
                -considered[c].half_value(objective, half), considered[c].bytes_per_frame, c,
            ),
        )  # fmt: skip
        other = 1 - half
        top_value = considered[top].half_value(objective, other)
        regrets.append(top_value - value.half_value(objective, other))
    return sum(regrets) / 2


def _possible(
    considered: Mapping[Choice, Outcome], capacity_bps: float, knowledge: Knowledge
) -> list[Choice]:
    allowed = (ALONE, *knowledge.algorithms)
    return [
        choice
        for choice, outcome in considered.items()
        if choice.algorithm in allowed and not outcome.overruns(knowledge.objective, capacity_bps)
    ]


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


def _neighbours(
    choice: Choice, candidates: Sequence[str], algorithms: Sequence[str]
) -> Iterator[Choice]:
    """One robot more or less, or another algorithm; from the ego alone, one robot with any."""
    members = set(choice.participants)
    for robot in candidates:
        changed = tuple(sorted(members ^ {robot}))
        if not changed:
            yield Choice((), ALONE)
            continue
        for algorithm in [choice.algorithm] if members else algorithms:
            yield Choice(changed, algorithm)
    if members:
        for other in algorithms:
            yield Choice(choice.participants, other)
