"""What came of every policy's decisions: a row a window, and means over all windows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ego_agent.knowledge.base import Knowledge
from research.evaluation.bootstrap import Interval, bootstrap_mean
from research.evaluation.policies.controls import AT_RANDOM, FIRST
from research.evaluation.policies.decide import Decided
from research.evaluation.policies.work_items import Outcomes, Place, knowledge_of
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.windows.search import best, held_out_regret

ORACLE = "oracle"
STATIC = "static-"
COVERAGE = "coverage"
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
    delivered_ap_70: float
    """AP@0.7 of what came in time when the window was played."""
    value: float
    """AP@0.7 - lambda C of what comes in time."""
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
    ap_70_with_known: float
    """Of the robots of which beacons tell, too."""
    delivered_ap_70: float
    bytes_per_frame: float
    ego_ms_per_frame: float
    """The ego's work for a fused frame, by the model of compute."""
    in_time_ratio: float
    """Contributions in time, of those that fused frames could have had."""
    fused_ratio: float
    """Frames fused, of those of the windows."""
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
    lost_where_it_fits: Interval
    """The same in the windows whose link carries the static policy."""
    lost_delivered: Interval
    """Delivered AP@0.7 less that of the static policy that delivers best, a window."""
    lost_to_coverage: Interval
    """AP@0.7 less that of `coverage`, a window."""
    beats_coverage_ratio: float
    """Windows in which its value exceeds that of `coverage`; NaN where that is not compared."""
    loses_to_coverage_ratio: float
    """Windows in which it is below."""
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
    value = outcome.value(objective)
    return Row(
        scenario=scenario,
        decided=one,
        outcome=outcome,
        capacity_bps=capacity_bps,
        infeasible=infeasible,
        delivered_ap_70=outcome.arrived.ap_70,
        value=value,
        regret=top.value(objective) - value,
        held_out_regret=held_out_regret(known, outcome, capacity_bps, knowledge),
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
    beside = _beside(by_policy)
    return [_means(name, own, beside) for name, own in by_policy.items()]


@dataclass(frozen=True, slots=True)
class _Beside:
    """What all policies are compared with; empty where that is not among them."""

    best: Sequence[Row]
    """The static policy, full participation, of the highest AP@0.7."""
    fitting: Sequence[Row]
    """Of it, the windows whose link carries it."""
    delivering: Sequence[Row]
    """The static policy that delivers the highest AP@0.7."""
    coverage: Sequence[Row]


def _beside(by_policy: Mapping[str, Sequence[Row]]) -> _Beside:
    static = [rows for name, rows in by_policy.items() if name.startswith(STATIC)]

    def best(ap_70: Callable[[Row], float]) -> Sequence[Row]:
        return max(static, key=lambda rows: np.mean([ap_70(row) for row in rows]), default=())

    return _Beside(
        best=best(_measured),
        fitting=[row for row in best(_measured) if not row.infeasible],
        delivering=best(_delivered),
        coverage=by_policy.get(COVERAGE, ()),
    )


def _measured(row: Row) -> float:
    return row.outcome.ap_70


def _delivered(row: Row) -> float:
    return row.delivered_ap_70


def _means(name: str, rows: Sequence[Row], beside: _Beside) -> Means:
    outcomes = [row.outcome for row in rows]
    took_ms = [1e3 * row.decided.decision_s for row in rows]
    p50, p99 = np.percentile(took_ms, [50, 99]).tolist() if _is_timed(name) else (None, None)
    answers = [float(r.decided.answered) for r in rows if r.decided.answered is not None]
    gained = [row.value - other.value for row, other in pairs(rows, beside.coverage)]
    used = float(np.mean([outcome.bytes_per_frame for outcome in outcomes]))
    everyone = _bytes(beside.best) if beside.best else float("nan")
    return Means(
        policy=name,
        windows=len(rows),
        ap_30=float(np.mean([outcome.ap_30 for outcome in outcomes])),
        ap_50=float(np.mean([outcome.ap_50 for outcome in outcomes])),
        ap_70=float(np.mean([outcome.ap_70 for outcome in outcomes])),
        ap_70_with_known=float(np.mean([outcome.ap_70_with_known for outcome in outcomes])),
        delivered_ap_70=float(np.mean([row.delivered_ap_70 for row in rows])),
        bytes_per_frame=used,
        ego_ms_per_frame=float(np.mean([one.arrived.ego_ms_per_frame for one in outcomes])),
        in_time_ratio=float(np.mean([one.arrived.in_time_ratio for one in outcomes])),
        fused_ratio=float(np.mean([one.arrived.fused_ratio for one in outcomes])),
        infeasible_ratio=float(np.mean([row.infeasible for row in rows])),
        participants_mean=float(np.mean([1 + len(r.decided.choice.participants) for r in rows])),
        regret_mean=float(np.mean([row.regret for row in rows])),
        held_out_regret_mean=_mean(
            [row.held_out_regret for row in rows if row.held_out_regret is not None]
        ),
        decision_ms_p50=p50,
        decision_ms_p99=p99,
        answered_ratio=_mean(answers) if answers else None,
        lost_ap_70=_paired(rows, beside.best, _measured),
        lost_where_it_fits=_paired(rows, beside.fitting, _measured),
        lost_delivered=_paired(rows, beside.delivering, _delivered),
        lost_to_coverage=_paired(rows, beside.coverage, _measured),
        beats_coverage_ratio=_mean([float(value > 0) for value in gained]),
        loses_to_coverage_ratio=_mean([float(value < 0) for value in gained]),
        saved=1 - used / everyone if everyone else 0.0,
    )


def _is_timed(policy: str) -> bool:
    """Whether it decides anything in a time of its own."""
    return policy != ORACLE and not policy.endswith((AT_RANDOM, FIRST))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _bytes(rows: Sequence[Row]) -> float:
    return float(np.mean([row.outcome.bytes_per_frame for row in rows]))


def pairs(rows: Sequence[Row], others: Sequence[Row]) -> list[tuple[Row, Row]]:
    """Each row with the other of the same window, where there is one."""
    theirs = {(r.decided.scenario, r.decided.window): r for r in others}
    keys = [(r.decided.scenario, r.decided.window) for r in rows]
    return [(row, theirs[key]) for row, key in zip(rows, keys, strict=True) if key in theirs]


def _paired(rows: Sequence[Row], others: Sequence[Row], ap_70: Callable[[Row], float]) -> Interval:
    """AP@0.7 less that of the others in the same windows."""
    found = pairs(rows, others)
    return bootstrap_mean(
        [ap_70(row) - ap_70(other) for row, other in found],
        [row.scenario.group for row, _ in found],
    )
