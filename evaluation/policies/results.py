"""What came of every policy's decisions: a row a window, and means over all windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ego_agent.knowledge import Knowledge
from evaluation.bootstrap import Interval, bootstrap_mean
from evaluation.policies.decide import Decided
from evaluation.policies.pieces import Outcomes
from evaluation.windows.choice import Choice, Outcome
from evaluation.windows.scenarios import Scenario
from evaluation.windows.search import best, held_out_regret

ORACLE = "oracle"
STATIC = "static-"


@dataclass(frozen=True, slots=True)
class Row:
    """One policy in one window."""

    scenario: Scenario
    decided: Decided
    outcome: Outcome
    capacity_bps: float
    value: float
    """AP@0.7 - lambda C, with what was measured."""
    regret: float
    """What the oracle's value is above it; below 0 only where the link could not carry this."""
    held_out_regret: float
    """The same against an oracle that is judged by frames it has not seen."""
    infeasible: bool
    """It needs more than all of C(t)."""


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
    lost_ap_70: Interval
    """AP@0.7 less that of the best static policy, a window."""
    lost_to_coverage: Interval
    """AP@0.7 less that of `coverage`, a window."""
    saved: float
    """Share of the best static policy's bytes that it saves."""


def rows_of(
    scenarios: Mapping[str, Scenario],
    decided: Sequence[Decided],
    outcomes: Mapping[tuple[str, int], Outcomes],
    knowledge: Knowledge,
) -> list[Row]:
    """A row for each decision, and the oracle's. Windows without a true box are left out."""
    rows = []
    for (name, window), known in outcomes.items():
        scenario = scenarios[name]
        capacity_bps = scenario.capacity_bps(window)
        top = best(known, knowledge, capacity_bps)
        if not known[top].ground_truth:
            continue
        top_value = known[top].value(knowledge.objective)
        here = [d for d in decided if (d.scenario, d.window) == (name, window)]
        if here:
            here.append(_oracle(here[0], top, known[top]))
        for one in here:
            outcome = known[one.choice]
            value = outcome.value(knowledge.objective)
            infeasible = outcome.overruns(knowledge.objective, capacity_bps)
            rows.append(
                Row(
                    scenario=scenario,
                    decided=one,
                    outcome=outcome,
                    capacity_bps=capacity_bps,
                    value=value,
                    regret=top_value - value,
                    held_out_regret=held_out_regret(known, one.choice, knowledge, capacity_bps),
                    infeasible=infeasible,
                )
            )
    return rows


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
        held_out_regret_mean=float(np.mean([row.held_out_regret for row in rows])),
        decision_ms_p50=p50,
        decision_ms_p99=p99,
        lost_ap_70=_paired(rows, by_policy.get(static or "", ())),
        lost_to_coverage=_paired(rows, by_policy.get("coverage", ())),
        saved=1 - used / everyone if everyone else 0.0,
    )


def _bytes(rows: Sequence[Row]) -> float:
    return float(np.mean([row.outcome.bytes_per_frame for row in rows]))


def _paired(rows: Sequence[Row], others: Sequence[Row]) -> Interval:
    """AP@0.7 less that of the others in the same windows."""
    theirs = {(r.decided.scenario, r.decided.window): r.outcome.ap_70 for r in others}
    keys = [(r.decided.scenario, r.decided.window) for r in rows]
    return bootstrap_mean(
        [r.outcome.ap_70 - theirs[k] for r, k in zip(rows, keys, strict=True) if k in theirs]
    )
