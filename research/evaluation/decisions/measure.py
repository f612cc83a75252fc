"""How a chooser's decisions stand beside those of `coverage`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from statistics import median
from typing import Any

from ego_agent.plan.advice.judge import Advised, judge, repaired
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting.short import short_options, short_scene
from ego_agent.settings import EgoSettings
from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.decisions.choosers import Case, Chooser, Said
from research.training.decisions.scenes import Split, known, scene_groups
from swarm.messages import ALGORITHMS, MIXED

Choice = frozenset[tuple[str, str]]
"""Helpers, each with the algorithm by which it sends."""
DIGITS = 4


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one answer."""

    said: Said
    lost: float
    """Value below that of `coverage`, after validation; that of the ego alone where nothing of the
    answer can be used."""
    judged: Score
    """What the ego decides: the advice where it stands the test, else what `coverage` chose."""
    adopted: bool


def cases(split: Split, seed: int, groups: int) -> list[Case]:
    """The scenes of so many groups, each at all its rates, rising."""
    knowledge = known()
    return [
        _case(Scorer(scene, knowledge), number)
        for number, group in enumerate(islice(scene_groups(split, seed), groups))
        for scene in group
    ]


def _case(scorer: Scorer, group: int) -> Case:
    short = short_scene(scorer)
    return Case(scorer, short, short_options(scorer, short), group)


def wanted(case: Case) -> Score:
    """What `coverage` decides where nothing was decided before."""
    best, _ = Coverage().choose(case.scorer, None)
    return best


def outcome(case: Case, said: Said, best: Score) -> Outcome:
    """What validation and the judge make of an answer."""
    scorer = case.scorer
    alone = scorer.score((), scorer.knowledge.best_algorithm())
    if said.sends is None:
        return Outcome(said, best.value - alone.value, best, adopted=False)
    kinds = sorted(set(said.sends.values()))
    algorithm = MIXED if len(kinds) > 1 else next(iter(kinds), alone.algorithm)
    known = {name: name for name in ALGORITHMS}
    sends = {robot: known[name] for robot, name in said.sends.items() if name in known}
    named = (scorer.scene.ego.robot, *said.sends)
    advice = Advised(named, algorithm, sends if algorithm == MIXED else {})
    score = repaired(advice, scorer).score or alone
    verdict = judge(advice, scorer, best, margin=EgoSettings().llm_value_margin)
    judged = best if verdict.refused is not None or verdict.score is None else verdict.score
    return Outcome(said, best.value - score.value, judged, adopted=verdict.refused is None)


def choice(sends: Mapping[str, str]) -> Choice:
    """What is compared: how often each sends is code's to say."""
    return frozenset(sends.items())


def row(chooser: Chooser, asked: Sequence[Case]) -> tuple[dict[str, Any], list[Said]]:
    """The figures of one chooser, shares and values with the interval over scenes; its answers."""
    best = [wanted(case) for case in asked]
    found = [
        outcome(case, chooser.choose(case), one) for case, one in zip(asked, best, strict=True)
    ]
    groups = [case.group for case in asked]
    theirs = [choice(one.sends) for one in best]
    ours = [None if o.said.sends is None else choice(o.said.sends) for o in found]
    judged = [choice(o.judged.sends) for o in found]
    steps = list(_steps(groups, ours, theirs))
    report: dict[str, Any] = {"chooser": chooser.name, "answers": len(found)}
    equal = [own == other for own, other in zip(ours, theirs, strict=True)]
    report |= _mean("equal_to_coverage", equal, groups)
    report |= _mean("link_steps_followed", [good for _, good in steps], [g for g, _ in steps])
    report["link_steps"] = len(steps)
    report |= _mean("value_lost", [o.lost for o in found], groups)
    report |= _mean("judged_equal", [a == b for a, b in zip(judged, theirs, strict=True)], groups)
    report |= _mean(
        "judged_value_lost",
        [one.value - o.judged.value for one, o in zip(best, found, strict=True)],
        groups,
    )
    report["adopted"] = round(sum(o.adopted for o in found) / len(found), DIGITS)
    report["readable"] = round(sum(o is not None for o in ours) / len(found), DIGITS)
    report["ms_p50"] = round(1e3 * median(o.said.took_s for o in found), 2)
    tokens = [o.said.tokens for o in found if o.said.tokens is not None]
    for name, counts in zip(("prompt", "answer"), zip(*tokens, strict=True), strict=False):
        report[f"{name}_tokens_p50"] = median(counts)
        report[f"{name}_tokens_most"] = max(counts)
    return report, [o.said for o in found]


def _mean(
    name: str, values: Sequence[float], groups: Sequence[int]
) -> dict[str, float | list[float]]:
    interval = bootstrap_mean([float(value) for value in values], groups)
    ends = [round(interval.low, DIGITS), round(interval.high, DIGITS)]
    return {name: round(interval.mean, DIGITS), f"{name}_interval": ends}


def _steps(
    groups: Sequence[int], ours: Sequence[Choice | None], theirs: Sequence[Choice]
) -> Iterator[tuple[int, bool]]:
    """Of each step of the rate at which `coverage` changes its choice: whether this one changes in
    the same way: to more robots, to fewer or to as many by each algorithm."""
    together = list(zip(groups, ours, theirs, strict=True))
    for (group, own, other), (next_group, own_next, other_next) in pairwise(together):
        if group == next_group and other != other_next:
            yield group, _change(own, own_next) == _change(other, other_next)


def _change(low: Choice | None, high: Choice | None) -> dict[str, int] | None:
    """By algorithm 1 for more helpers, -1 for fewer; None where an answer cannot be read."""
    if low is None or high is None:
        return None
    fewer, more = (Counter(name for _, name in one) for one in (low, high))
    return {
        name: 1 if more[name] > fewer[name] else -1
        for name in {*fewer, *more}
        if more[name] != fewer[name]
    }
