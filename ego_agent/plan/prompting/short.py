"""The short prompt: a question of some hundred tokens for a small model, answered in letters.

Code ranks the robots, tells what they add and cost, and what the link carries; the model says how
many of them help, and what each sends. How often is code's to say. docs/prompt.md explains every
line.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, combinations, pairwise

import numpy as np

from ego_agent.knowledge.base import CycleResult, Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.hysteresis import best_option
from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.options import compare
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.choices.union import Union
from ego_agent.plan.prompting.arrival import usual_in_time
from ego_agent.plan.prompting.fingerprint import scene_fingerprint
from ego_agent.plan.prompting.letters import Groups, helpers, letter, short_answer
from ego_agent.plan.prompting.prompt import LlmPrompt, check_ego
from ego_agent.plan.prompting.steps import at_most, shown
from ego_agent.plan.prompting.table import nameable, ranked
from swarm.messages import Algorithm, ChatMessage, Decision

GROUPS = 2
"""Algorithms of one answer: `coverage` mixes more in one of 100 scenes."""
MAX_LETTERS = 10
"""Robots that have a letter: `coverage` took more in none of 365 scenes of up to 11 robots."""
SYSTEM = "Pick helpers."
ALL_IN_TIME = 100
MOST_PRICE = 99
"""Percent: nothing is worth more."""


@dataclass(frozen=True, slots=True)
class ShortScene:
    """What the short prompt tells of a scene: everything that a chooser by numbers needs too."""

    robots: tuple[str, ...]
    """In the order of their letters."""
    seen: tuple[float, ...]
    """Percent of what all see, up to what the quality model counts: the ego, the ego and A, and so
    on."""
    kilobytes: Mapping[Algorithm, tuple[float, ...]]
    """Of A, of A and B, and so on, up to what the link carries at any rate."""
    price: Mapping[Algorithm, float]
    """Percent that a helper must add to be worth what it costs, on average."""
    fits: Mapping[Algorithm, tuple[int, int]]
    """How many the link carries, at the fastest rate and at any."""
    in_time: Mapping[Algorithm, int]
    """Percent of answers that usually come in time."""
    budget_kb: float
    """What a frame may cost at the fastest rate."""
    within_reach: bool
    """Whether any choice reaches Q_min."""

    @property
    def adds(self) -> tuple[float, ...]:
        """Percent that each robot adds to the ego and those before it."""
        return tuple(after - before for before, after in pairwise(self.seen))


def make_short_prompt(
    scene: UnifiedScene,
    knowledge: Knowledge,
    previous: Decision | None,
    result: CycleResult | None,
    *,
    scorer: Scorer | None = None,
) -> LlmPrompt:
    """The question that a scene poses, as `make_prompt` makes it, in short; nothing is told of the
    decision in force, as the judge holds on to it."""
    ego = check_ego(scene)
    scorer = scorer or Scorer(scene, knowledge)
    short = short_scene(scorer)
    # Letters mean other robots in another order: an answer holds for this one only.
    named = f"short {' '.join(short.robots)} {scene_fingerprint(scorer)}"
    answers = [short_answer(groups) for groups in short_options(scorer, short)]
    return LlmPrompt(
        messages=(
            ChatMessage(role="system", content=SYSTEM),
            ChatMessage(role="user", content=short_text(short)),
        ),
        schema=json.dumps({"type": "string", "enum": answers}, separators=(",", ":")),
        fingerprint=hashlib.sha256(named.encode()).hexdigest(),
        candidates=short.robots,
        ego=ego,
        letters=True,
        alone=knowledge.best_algorithm(),
    )


def short_scene(scorer: Scorer) -> ShortScene:
    """What the short prompt tells of the scorer's scene."""
    best = best_option(scorer, compare(scorer).options)
    robots = _order(scorer, best)
    rows = [scorer.row_of[robot] for robot in robots]
    algorithms = scorer.knowledge.algorithms
    fits = {name: _fits(scorer, robots, name) for name in algorithms}
    return ShortScene(
        robots=robots,
        seen=tuple(_seen(scorer, [0, *rows[:k]]) for k in range(len(rows) + 1)),
        kilobytes={
            name: tuple(
                size / 1e3
                for size in accumulate(scorer.size(r, name) for r in robots[: fits[name][1]])
            )
            for name in algorithms
        },
        price={name: _price(scorer, rows, name) for name in algorithms},
        fits=fits,
        in_time={name: usual_in_time(scorer, robots, name) for name in algorithms},
        budget_kb=scorer.budget_bytes / 1e3,
        within_reach=scorer.good_enough(best),
    )


def short_options(scorer: Scorer, short: ShortScene) -> tuple[Groups, ...]:
    """What may be answered: nobody, the first robots by one algorithm, or those and the next by
    another one, as the link carries all of them at some rate; those that reach Q_min, all where
    none does."""
    alone = scorer.score((), scorer.knowledge.best_algorithm())
    found: dict[Groups, Score] = {(): alone}
    mixable = scorer.objective.rarer_hz and scorer.knowledge.mixable
    mixes = Mixes(scorer) if mixable else None
    for name, (_, slow) in short.fits.items():
        for k in range(1, slow + 1):
            found[((name, k),)] = _best(scorer, short.robots[:k], name, mixes)
    if mixes is not None:
        for groups in _mixed(short):
            score = mixes.rated_as(forms(short.robots, groups))
            if len(score.participants) == helpers(groups):
                found[groups] = score
    good = tuple(groups for groups, score in found.items() if scorer.good_enough(score))
    return good or tuple(found)


def forms(robots: Sequence[str], groups: Groups) -> dict[str, Algorithm]:
    """What each helper sends, of robots in the order of their letters."""
    each = [name for name, count in groups for _ in range(count)]
    return dict(zip(robots, each, strict=False))


def groups_of(short: ShortScene, score: Score) -> Groups | None:
    """The answer that says a choice; None where none does."""
    named = [score.algorithm_of(robot) for robot in short.robots if robot in score.participants]
    if set(short.robots[: len(named)]) != set(score.participants):
        return None
    kinds = dict.fromkeys(named)
    groups = tuple((name, named.count(name)) for name in kinds)
    whole = [name for name, count in groups for _ in range(count)]
    return groups if named == whole and len(groups) <= GROUPS else None


def _mixed(short: ShortScene) -> Iterator[Groups]:
    for first, then in combinations(short.fits, GROUPS):
        for i in range(1, short.fits[first][1] + 1):
            for k in range(i + 1, short.fits[then][1] + 1):
                yield (first, i), (then, k - i)


def _seen(scorer: Scorer, rows: list[int]) -> float:
    """Percent, up to what the quality model counts."""
    return 100 * min(scorer.knowledge.quality.enough, scorer.share(rows))


def _order(scorer: Scorer, best: Score) -> tuple[str, ...]:
    """Robots in the order of what they add, those of `coverage`'s best choice first, by what they
    send there."""
    tiers = [
        [robot for robot in best.participants if best.algorithm_of(robot) == name]
        for name in scorer.knowledge.algorithms
    ]
    first: list[str] = []
    for tier in tiers:
        first += _by_gain(scorer, first, tier)
    rest = (entry.candidate.robot for entry in ranked(scorer))
    found = [robot for robot in dict.fromkeys((*first, *rest)) if nameable(robot)]
    return tuple(found[:MAX_LETTERS])


def _by_gain(scorer: Scorer, before: Sequence[str], robots: Sequence[str]) -> list[str]:
    """Each time the one that adds most to the ego and those before it."""
    union = Union(scorer.views)
    for robot in before:
        union.add(scorer.row_of[robot], 1.0)
    found, left = [], sorted(robots)
    while left:
        rows = np.array([scorer.row_of[robot] for robot in left], dtype=np.intp)
        at = int(union.gains(rows, np.ones(len(rows))).argmax())
        union.add(int(rows[at]), 1.0)
        found.append(left.pop(at))
    return found


def _rank(scorer: Scorer, score: Score) -> tuple[bool, float]:
    good = scorer.good_enough(score)
    return good, score.value if good else score.quality


def _best(
    scorer: Scorer, robots: Sequence[str], algorithm: Algorithm, mixes: Mixes | None
) -> Score:
    """Of these robots at the pace, or with the rates, that suit them best, among those at which the
    links carry them."""
    at = [scorer.at(pace) for pace in scorer.paces]
    found = [one.score(robots, algorithm) for one in at if _carried(one, robots, algorithm)]
    if mixes is not None and _carried_rarely(scorer, robots, algorithm):
        found.append(mixes.rated(robots, algorithm))
    return max(found, key=lambda score: _rank(scorer, score))


def _fits(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> tuple[int, int]:
    """How many of the first robots the links carry: at the fastest pace, and at any."""
    firsts = [robots[:k] for k in range(1, len(robots) + 1)]
    counts = [
        sum(_carried(scorer.at(pace), first, algorithm) for first in firsts)
        for pace in scorer.paces
    ]
    rarely = sum(_carried_rarely(scorer, first, algorithm) for first in firsts)
    return counts[0], max(*counts, rarely)


def _carried(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> bool:
    return (
        all(scorer.can(robot, algorithm) for robot in robots)
        and sum(scorer.size(robot, algorithm) for robot in robots) <= scorer.budget_bytes
    )


def _carried_rarely(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> bool:
    """Whether the link carries all of them on average, each as rarely as may be."""
    if not scorer.knowledge.may_be_rarer(algorithm):
        return False
    if not all(scorer.known(robot, algorithm) for robot in robots):
        return False
    share = min(scorer.objective.rarer_hz) / scorer.objective.rate_hz
    sizes = [scorer.size(robot, algorithm) for robot in robots]
    return share * sum(sizes) <= scorer.budget_bytes


def _price(scorer: Scorer, rows: Sequence[int], algorithm: Algorithm) -> float:
    """Percent seen that pays for a robot's lambda C at the fastest pace, the mean of those that
    can send."""
    known = [row for row in rows if algorithm in scorer.scene.candidates[row - 1].sizes]
    gain = scorer.knowledge.quality.gain(algorithm)
    if not known or gain <= 0.0:
        return 0.0
    return 100 * sum(scorer.price(row, algorithm) for row in known) / len(known) / gain


def short_text(short: ShortScene) -> str:
    """The user's message: what changes fastest last."""
    late = any(percent != ALL_IN_TIME for percent in short.in_time.values())
    lines = [
        f"ego {_tenths(short.seen[0])}{''.join(_letters(short))}",
        f"price{' time' if late else ''} kB fit" + ("" if short.within_reach else " too little"),
    ]
    for name, (fast, slow) in short.fits.items():
        cells = [name, _tenths(min(MOST_PRICE, short.price[name]))]
        if late:
            cells.append(str(short.in_time[name]))
        cells.append(shown(at_most(short.kilobytes[name][-1])) if slow else "-")
        cells.append(str(fast) if fast == slow else f"{fast}/{slow}")
        lines.append(" ".join(cells))
    return "\n".join(lines) + f"\nlink {shown(at_most(short.budget_kb))}"


def _tenths(percent: float) -> str:
    """One digit more where it decides most."""
    return f"{percent:.1f}" if percent < 9.95 else f"{percent:.0f}"


def _letters(short: ShortScene) -> Iterator[str]:
    """For each robot what it adds to what is seen with those before it."""
    for at, adds in enumerate(short.adds):
        yield f" {letter(at)}{_tenths(max(0.0, adds))}"
