"""Which fault comes when: all of it follows from a seed."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Sequence

from research.chaos.faults.base import Kind
from research.chaos.history import Fault

FIRST_S = 1.0
CALM_S = 12.0
"""Nothing begins so long before the end: what was hit last has to come back."""
TRIES = 400


def schedule(
    seed: int, seconds: float, count: int, robots: Sequence[str], kinds: Sequence[Kind]
) -> tuple[Fault, ...]:
    """At most `count` faults in the order in which they begin.

    Every kind comes as often as another, give or take one. Two faults never hold the same part at
    once. Where there is no room for `count`, there are fewer.
    """
    chance = random.Random(seed)
    taken: dict[str, list[tuple[float, float]]] = defaultdict(list)
    faults: list[Fault] = []
    placed = True
    while placed and len(faults) < count:
        placed = False
        for kind in chance.sample(list(kinds), len(kinds)):
            fault = _place(kind, chance, seconds, robots, taken)
            if fault is not None and len(faults) < count:
                faults.append(fault)
                placed = True
    return tuple(sorted(faults, key=lambda fault: (fault.at_s, fault.kind)))


def _place(
    kind: Kind,
    chance: random.Random,
    seconds: float,
    robots: Sequence[str],
    taken: dict[str, list[tuple[float, float]]],
) -> Fault | None:
    """A fault of that kind at a time at which what it holds is free, and what it holds is taken."""
    for _ in range(TRIES):
        lasts_s = round(chance.uniform(*kind.lasts_s), 2)
        last_s = seconds - CALM_S - lasts_s
        if last_s <= FIRST_S:
            return None
        at_s = round(chance.uniform(FIRST_S, last_s), 2)
        target = chance.choice(list(robots)) if kind.targets else ""
        parts = [*kind.holds, *([target] if target else [])]
        until_s = at_s + lasts_s + kind.rest_s
        if all(until_s <= b or at_s >= e for part in parts for b, e in taken[part]):
            for part in parts:
                taken[part].append((at_s, until_s))
            seed = chance.getrandbits(32)
            return Fault(kind=kind.name, target=target, at_s=at_s, lasts_s=lasts_s, seed=seed)
    return None
