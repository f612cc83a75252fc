"""What came of every policy's decisions: a row a window, and means over all windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ego_agent.knowledge import Knowledge
from evaluation.bootstrap import Interval, bootstrap_mean
from evaluation.policies.decide import Decided
from evaluation.policies.pieces import Outcomes, Place, knowledge_of
from evaluation.windows.choice import ALONE, Choice, Outcome
from evaluation.windows.scenarios import Scenario
from evaluation.windows.search import best, held_out_regret

ORACLE = "oracle"
STATIC = "static-"
ALONE_CHOICE = Choice((), ALONE)


@dataclass(frozen=True, slots=True)
class Row:
    """One policy in one window."""

    scenario: Scenario
    decided: Decided
    outcome: Outcome
    capacity_bps: float
    infeasible: bool
    """It needs more than all of C(t)."""
    value: float
    """AP@0.7 - lambda C, with what was measured; that of the ego alone where it is infeasible, for
    then nothing comes in time."""
    regret: float
    """What the oracle's value is above it."""
    held_out_regret: float | None
    """The same against an oracle that is judged by frames it has not seen (search.py)."""


@dataclass(frozen=True, slots=True)
class Means:
    """One policy over all windows that hold a true box."""

    policy: str
    windows: int
    ap_30: float
    ap_50: float
    ap_70: float
    bytes_per_frame: float
    infeasible_ratio: float
    participants_mean: float
    """The ego included."""
    regret_mean: float
    held_out_regret_mean: float
    decision_ms_p50: float | None
    decision_ms_p99: float | None
    answered_ratio: float | None
    """Of a language model: windows in which its newest question had an answer."""
    lost_ap_70: Interval
    """AP@0.7 less that of the best static policy, a window."""
    lost_to_coverage: Interval
    """AP@0.7 less that of `coverage`, a window."""
    saved: float
    """Share of the best static policy's bytes that it saves."""


def rows_of(
    scenarios: Mapping[str, Scenario],
    decided: Sequence[Decided],
    considered: Mapping[Place, Outcomes],
    algorithms: Sequence[str],
) -> list[Row]:
    """A row for each decision, and the oracle's. Windows without a true box are left out.

    considered: of each window, the outcomes among which the oracle finds its own, those of the
        decisions among them.
    """
    here: dict[Place, list[Decided]] = {}
    for one in decided:
        here.setdefault((one.scenario, one.window), []).append(one)
    rows = []
    for place, known in considered.items():
        if not known[ALONE_CHOICE].ground_truth or place not in here:
            continue
        scenario = scenarios[place[0]]
        knowledge = knowledge_of(algorithms, scenario)
        top = best(known, scenario.capacity_bps(place[1]), knowledge)
        for one in (*here[place], _oracle(here[place][0], top, known[top])):
            rows.append(_row(scenario, one, known, known[top], knowledge))
    return rows


def _row(
    scenario: Scenario, one: Decided, known: Outcomes, top: Outcome, knowledge: Knowledge
) -> Row:
    objective, capacity_bps = knowledge.objective, scenario.capacity_bps(one.window)
    outcome = known[one.choice]
    infeasible = outcome.overruns(objective, capacity_bps)
    arrived = known[ALONE_CHOICE] if infeasible else outcome
    value = arrived.value(objective)
    return Row(
        scenario=scenario,
        decided=one,
        outcome=outcome,
        capacity_bps=capacity_bps,
        infeasible=infeasible,
        value=value,
        regret=top.value(objective) - value,
        held_out_regret=held_out_regret(known, arrived, capacity_bps, knowledge),
    )


def _oracle(like: Decided, choice: Choice, outcome: Outcome) -> Decided:
    return replace(
        like,
        policy=ORACLE,
        choice=choice,
        predicted_bytes=round(outcome.bytes_per_frame),
        reason="The best of all that was measured.",
        source=ORACLE,
        decision_s=0.0,
        repairs=(),
    )


def means_of(rows: Sequence[Row]) -> list[Means]:
    """The means of every policy, in the order in which the policies first come."""
    by_policy: dict[str, list[Row]] = {}
    for row in rows:
        by_policy.setdefault(row.decided.policy, []).append(row)
    reference = best_static(by_policy)
    return [_means(name, own, by_policy, reference) for name, own in by_policy.items()]


def best_static(by_policy: Mapping[str, Sequence[Row]]) -> str | None:
    """The static policy of the highest AP@0.7: full participation."""
    static = [name for name in by_policy if name.startswith(STATIC)]
    if not static:
        return None
    return max(static, key=lambda name: np.mean([row.outcome.ap_70 for row in by_policy[name]]))


def _means(
    name: str, rows: Sequence[Row], by_policy: Mapping[str, Sequence[Row]], static: str | None
) -> Means:
    outcomes = [row.outcome for row in rows]
    took_ms = [1e3 * row.decided.decision_s for row in rows]
    p50, p99 = np.percentile(took_ms, [50, 99]).tolist() if name != ORACLE else (None, None)
    answers = [float(r.decided.answered) for r in rows if r.decided.answered is not None]
    used = float(np.mean([outcome.bytes_per_frame for outcome in outcomes]))
    everyone = _bytes(by_policy[static]) if static else float("nan")
    return Means(
        policy=name,
        windows=len(rows),
        ap_30=float(np.mean([outcome.ap_30 for outcome in outcomes])),
        ap_50=float(np.mean([outcome.ap_50 for outcome in outcomes])),
        ap_70=float(np.mean([outcome.ap_70 for outcome in outcomes])),
        bytes_per_frame=used,
        infeasible_ratio=float(np.mean([row.infeasible for row in rows])),
        participants_mean=float(np.mean([1 + len(r.decided.choice.participants) for r in rows])),
        regret_mean=float(np.mean([row.regret for row in rows])),
        held_out_regret_mean=_mean(
            [row.held_out_regret for row in rows if row.held_out_regret is not None]
        ),
        decision_ms_p50=p50,
        decision_ms_p99=p99,
        answered_ratio=_mean(answers) if answers else None,
        lost_ap_70=_paired(rows, by_policy.get(static or "", ())),
        lost_to_coverage=_paired(rows, by_policy.get("coverage", ())),
        saved=1 - used / everyone if everyone else 0.0,
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _bytes(rows: Sequence[Row]) -> float:
    return float(np.mean([row.outcome.bytes_per_frame for row in rows]))


def _paired(rows: Sequence[Row], others: Sequence[Row]) -> Interval:
    """AP@0.7 less that of the others in the same windows."""
    theirs = {(r.decided.scenario, r.decided.window): r.outcome.ap_70 for r in others}
    keys = [(r.decided.scenario, r.decided.window) for r in rows]
    pairs = [(row, theirs[key]) for row, key in zip(rows, keys, strict=True) if key in theirs]
    return bootstrap_mean(
        [row.outcome.ap_70 - other for row, other in pairs],
        [row.scenario.group for row, _ in pairs],
    )
