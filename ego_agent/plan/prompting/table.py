"""Which robots a language model hears of, and what it is told of each: few and coarse numbers.

Nothing here depends on C(t), as long as it carries anything of the same robots at all: a change of
bandwidth must not change the table, which a model has read already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ego_agent.knowledge.model import Candidate
from ego_agent.plan.choices.greedy import SMALLEST_GAIN
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.union import Union
from ego_agent.plan.prompting.steps import coarse, percent, place, shown
from swarm.errors import KeyspaceError
from swarm.keyspace import check_name
from swarm.messages import Algorithm

MAX_LISTED = 16
"""Robots in the table; more are only counted. What the 17th adds is a few percent at most."""
STEP_M = 10
HALF_SEEN = 0.5
"""Evidence from which an object counts as seen."""


@dataclass(frozen=True, slots=True)
class Ranked:
    """A candidate that may be asked for, and what it adds to those ranked before it."""

    candidate: Candidate
    adds: float
    """Share of all that anyone sees, in [0, 1]."""


def nameable(robot: str) -> bool:
    """Whether an id is one that a swarm's key may hold: nothing else may stand in a prompt."""
    try:
        check_name("robot id", robot)
    except (KeyspaceError, TypeError):
        return False
    return True


def usable(scorer: Scorer, robot: str, algorithm: Algorithm) -> bool:
    """Whether the links carry this robot's observations, if nobody else sends any."""
    return scorer.can(robot, algorithm) and scorer.size(robot, algorithm) <= scorer.budget_bytes


def ranked(scorer: Scorer, limit: int = MAX_LISTED) -> tuple[Ranked, ...]:
    """The best candidates, by what each adds to the ego and those before it, then by id.

    Left out: those that add nothing to the ego, or whose observations no link carries in any form.
    What each one costs does not count: it is in the table.
    """
    able = sorted(
        (
            c
            for c in scorer.scene.candidates
            if nameable(c.robot) and any(usable(scorer, c.robot, a) for a in c.sizes)
        ),
        key=lambda c: c.robot,
    )
    rows = np.array([scorer.row_of[c.robot] for c in able], dtype=np.intp)
    union, certain = Union(scorer.views), np.ones(len(rows))
    keep = union.gains(rows, certain) > SMALLEST_GAIN if able else np.zeros(0, bool)
    rows, left = rows[keep], [c for c, kept in zip(able, keep, strict=True) if kept]
    found: list[Ranked] = []
    while left and len(found) < limit:
        gains = union.gains(rows, np.ones(len(rows)))
        # Gains that look the same in the table go by id, so that its order does not tremble.
        at = min(range(len(left)), key=lambda i: (-percent(float(gains[i])), left[i].robot))
        found.append(Ranked(left.pop(at), float(gains[at])))
        union.add(int(rows[at]), 1.0)
        rows = np.delete(rows, at)
    return tuple(found)


def robot_row(scorer: Scorer, entry: Ranked, costs: Sequence[Algorithm]) -> str:
    """One robot's line: id, place, kB by algorithm, and what it sees beside the ego."""
    candidate = entry.candidate
    row = scorer.row_of[candidate.robot]
    alone = scorer.share([0, row]) - scorer.share([0])
    ego_sees = scorer.views.evidence[0] >= HALF_SEEN
    new = int(np.count_nonzero((scorer.views.evidence[row] >= HALF_SEEN) & ~ego_sees))
    cells = [
        candidate.robot,
        *(str(place(way, STEP_M)) for way in (candidate.pose.x, candidate.pose.y)),
        *(_kilobytes(candidate, name) for name in costs),
        str(percent(alone)),
        shown(coarse(new)),
        str(percent(overlap(scorer, row))),
        str(percent(entry.adds)),
    ]
    return " ".join(cells)


def _kilobytes(candidate: Candidate, algorithm: Algorithm) -> str:
    size = candidate.sizes.get(algorithm)
    return "-" if size is None else shown(coarse(size / 1e3))


def overlap(scorer: Scorer, row: int) -> float:
    """The part of what a robot sees that the ego sees too, in [0, 1]; 0 where it sees nothing."""
    own = scorer.share([row])
    if own <= 0.0 or scorer.nothing_to_see:
        return 0.0
    return max(0.0, (own + scorer.share([0]) - scorer.share([0, row])) / own)
