"""The short prompt: a question of some hundred tokens for a small model, answered in letters.

Code ranks the robots, adds up what they show and cost, and says what the link carries; the model
says how many of them help, and with which algorithm. docs/prompt.md explains every line.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

from ego_agent.knowledge.base import CycleResult, Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.greedy import grow
from ego_agent.plan.choices.hysteresis import best_option
from ego_agent.plan.choices.options import all_options
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.prompting.arrival import usual_in_time
from ego_agent.plan.prompting.fingerprint import scene_fingerprint
from ego_agent.plan.prompting.letters import letter, short_answer
from ego_agent.plan.prompting.prompt import LlmPrompt, check_ego
from ego_agent.plan.prompting.steps import at_most, shown
from ego_agent.plan.prompting.table import nameable, ranked
from swarm.messages import Algorithm, ChatMessage, Decision

MAX_LETTERS = 8
"""Robots that have a letter: `coverage` takes more in one of 500 scenes."""
SYSTEM = "Pick helpers."
ALL_IN_TIME = 100
MOST_PRICE = 99
"""Percent: nothing is worth more."""


@dataclass(frozen=True, slots=True)
class ShortScene:
    """What the short prompt tells of a scene: everything that a chooser by numbers needs too."""

    robots: tuple[str, ...]
    """In the order of their letters."""
    seen: tuple[int, ...]
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
    options: tuple[tuple[Algorithm, int], ...]
    """What may be answered: the algorithm and how many help; those that reach Q_min, all where none
    does. Alone is (the best algorithm, 0)."""
    within_reach: bool
    """Whether any option reaches Q_min."""

    @property
    def adds(self) -> tuple[int, ...]:
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
    return LlmPrompt(
        messages=(
            ChatMessage(role="system", content=SYSTEM),
            ChatMessage(role="user", content=short_text(short)),
        ),
        schema=json.dumps(
            {"type": "string", "enum": list(short_answers(short))}, separators=(",", ":")
        ),
        fingerprint=hashlib.sha256(named.encode()).hexdigest(),
        candidates=short.robots,
        ego=ego,
        letters=True,
        alone=knowledge.best_algorithm(),
    )


def short_scene(scorer: Scorer) -> ShortScene:
    """What the short prompt tells of the scorer's scene."""
    robots = _order(scorer)
    rows = [scorer.row_of[robot] for robot in robots]
    algorithms = scorer.knowledge.algorithms
    fits = {name: _fits(scorer, robots, name) for name in algorithms}
    found = {
        (name, k): _best(scorer, robots[:k], name)
        for name in algorithms
        for k in range(1, fits[name][1] + 1)
    }
    alone = scorer.knowledge.best_algorithm()
    found[alone, 0] = scorer.score((), alone)
    good = tuple(option for option, score in found.items() if scorer.good_enough(score))
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
        options=good or tuple(found),
        within_reach=bool(good),
    )


def _seen(scorer: Scorer, rows: list[int]) -> int:
    """Percent, up to what the quality model counts."""
    return round(100 * min(scorer.knowledge.quality.enough, scorer.share(rows)))


def _order(scorer: Scorer) -> tuple[str, ...]:
    """Robots in the order in which `coverage` lets them join up to its best choice, then the rest
    by what they add."""
    best = best_option(scorer, list(all_options(scorer)))
    at, wanted = scorer.at(best.pace), set(best.participants)
    orders = (_joining(at, best.algorithm, by_byte=by_byte) for by_byte in (False, True))
    first = next((o for o in orders if set(o[: len(wanted)]) == wanted), [])
    rest = (entry.candidate.robot for entry in ranked(scorer))
    found = [robot for robot in dict.fromkeys((*first, *rest)) if nameable(robot)]
    return tuple(found[:MAX_LETTERS])


def _joining(scorer: Scorer, algorithm: Algorithm, *, by_byte: bool) -> list[str]:
    joined: dict[str, None] = {}
    for score in grow(scorer, scorer.scene.candidates, algorithm, by_byte=by_byte):
        joined.update(dict.fromkeys(score.participants))
    return list(joined)


def _rank(scorer: Scorer, score: Score) -> tuple[bool, float]:
    good = scorer.good_enough(score)
    return good, score.value if good else score.quality


def _best(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> Score:
    """Of these robots at the pace that suits them best, among those at which the links carry
    them."""
    at = [scorer.at(pace) for pace in scorer.paces]
    able = [one for one in at if _carried(one, robots, algorithm)]
    return max((one.score(robots, algorithm) for one in able), key=lambda s: _rank(scorer, s))


def _fits(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> tuple[int, int]:
    """How many of the first robots the links carry: at the fastest pace, and at any."""
    counts = [
        sum(_carried(scorer.at(pace), robots[:k], algorithm) for k in range(1, len(robots) + 1))
        for pace in scorer.paces
    ]
    return counts[0], max(counts)


def _carried(scorer: Scorer, robots: Sequence[str], algorithm: Algorithm) -> bool:
    return (
        all(scorer.can(robot, algorithm) for robot in robots)
        and sum(scorer.size(robot, algorithm) for robot in robots) <= scorer.budget_bytes
    )


def _price(scorer: Scorer, rows: Sequence[int], algorithm: Algorithm) -> float:
    """Percent seen that pays for a robot's lambda C at the fastest pace, the mean of those that
    can send."""
    known = [row for row in rows if algorithm in scorer.scene.candidates[row - 1].sizes]
    gain = scorer.knowledge.quality.gain(algorithm)
    if not known or gain <= 0.0:
        return 0.0
    return 100 * sum(scorer.price(row, algorithm) for row in known) / len(known) / gain


def short_answers(short: ShortScene) -> Iterator[str]:
    """All that may be answered."""
    return (short_answer(name, helpers) for name, helpers in short.options)


def short_text(short: ShortScene) -> str:
    """The user's message: what changes fastest last."""
    late = any(percent != ALL_IN_TIME for percent in short.in_time.values())
    lines = [
        f"ego {short.seen[0]}{''.join(_letters(short))}",
        f"price{' time' if late else ''} kB fit" + ("" if short.within_reach else " too little"),
    ]
    for name, (fast, slow) in short.fits.items():
        cells = [name, _price_shown(short.price[name])]
        if late:
            cells.append(str(short.in_time[name]))
        cells.append(shown(at_most(short.kilobytes[name][-1])) if slow else "-")
        cells.append(str(fast) if fast == slow else f"{fast}/{slow}")
        lines.append(" ".join(cells))
    return "\n".join(lines) + f"\nlink {shown(at_most(short.budget_kb))}"


def _price_shown(percent: float) -> str:
    """One digit more where it decides most."""
    return f"{percent:.1f}" if percent < 9.95 else f"{min(MOST_PRICE, percent):.0f}"


def _letters(short: ShortScene) -> Iterator[str]:
    """For each robot what is seen with it, and what it adds to that."""
    for at, (seen, adds) in enumerate(zip(short.seen[1:], short.adds, strict=True)):
        yield f" {letter(at)}{seen}+{adds}"
