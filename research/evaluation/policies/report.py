"""The tables of a comparison as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from research.evaluation.policies.as_published import tables
from research.evaluation.policies.beside import LEAST_GROUPS, beside_controls, controls_table
from research.evaluation.policies.controls import is_control
from research.evaluation.policies.results import Means, Row
from research.evaluation.tables import markdown
from research.evaluation.windows.contents import Contents


def report(
    means: Sequence[Means], claims: Sequence[Mapping[str, Any]], rows: Sequence[Row], held: Contents
) -> str:
    """The policies' means, the claims, controls, bytes as the paper counts them, and every policy's
    answer to the named scenarios."""
    parts = [
        "# Policies on the same control windows",
        f"{means[0].windows} windows. AP: mean of the windows. Regret: in AP@0.7 - lambda C, "
        "against the best choice that was measured; held out: the best on one half of the frames, "
        "judged by the other. Infeasible: needs more than all of C(t). With known: AP@0.7 "
        "also of the robots of which beacons tell. Delivered: AP@0.7 of "
        "what came before the deadline when the window was played with delays (compute.json). In "
        "time: contributions, of those of fused frames. Value: delivered AP@0.7 - lambda C.",
        table(means),
        "## Claims",
        markdown(
            ("claim", "measured", "target", "met"),
            [
                (one["what"], one["value"], one["target"], "yes" if one["met"] else "no")
                for one in claims
            ],
        ),
    ]
    if compared := beside_controls(rows):
        parts += [
            "## Policies beside their controls",
            "Each policy less its control in the same windows, with the 95 % interval of the "
            "paired differences: better or worse only where that excludes 0, and not told of fewer "
            f"than {LEAST_GROUPS} floors or recordings. Controls take as many "
            "robots as the policy, with its algorithm, on the same link; "
            "where that is everyone, they choose the same.",
            controls_table(compared),
        ]
    advised = [one for one in means if one.answered_ratio is not None]
    if advised:
        parts += ["## Language models beside `coverage`", _advised(advised)]
    parts += [
        "## Bytes as they are sent, and as the paper counts them",
        "The published results count float32: of early all points with x, y, z and intensity, of "
        "intermediate the whole feature map, of late seven numbers for each true object within a "
        "sensor's range. Means a frame; infeasible: needs more than all of C(t).",
        *tables(rows, held),
    ]
    named = [row for row in rows if row.scenario.expectation is not None]
    if named:
        parts += ["## The paper's motivating snapshots, first windows", _answers(named)]
    return "\n\n".join(parts) + "\n"


def table(means: Sequence[Means]) -> str:
    """A line a policy."""
    return markdown(
        (
            "policy", "AP@0.3", "AP@0.5", "AP@0.7", "with known", "delivered", "in time", "ego ms",
            "kB/frame", "robots", "infeasible", "regret", "held out", "decision ms p50", "p99",
        ),
        [
            (
                one.policy, f"{one.ap_30:.3f}", f"{one.ap_50:.3f}", f"{one.ap_70:.3f}",
                f"{one.ap_70_with_known:.3f}", f"{one.delivered_ap_70:.3f}",
                f"{one.in_time_ratio:.0%}", f"{one.ego_ms_per_frame:.0f}",
                f"{one.bytes_per_frame / 1e3:.1f}", f"{one.participants_mean:.1f}",
                f"{one.infeasible_ratio:.0%}", f"{one.regret_mean:.3f}",
                f"{one.held_out_regret_mean:.3f}",
                _milliseconds(one.decision_ms_p50), _milliseconds(one.decision_ms_p99),
            )
            for one in means
        ],
    )  # fmt: skip


def _advised(means: Sequence[Means]) -> str:
    """In how many windows language models' choices, checked and repaired, are worth more."""
    return markdown(
        ("policy", "answered", "value above", "equal", "below", "AP@0.7, paired difference"),
        [
            (
                one.policy,
                f"{one.answered_ratio or 0:.0%}",
                f"{one.beats_coverage_ratio:.0%}",
                f"{1 - one.beats_coverage_ratio - one.loses_to_coverage_ratio:.0%}",
                f"{one.loses_to_coverage_ratio:.0%}",
                str(one.lost_to_coverage),
            )
            for one in means
        ],
    )


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _answers(rows: Sequence[Row]) -> str:
    """The named scenarios' first windows: who was expected and who was chosen."""
    lines = []
    for row in rows:
        expectation, decided = row.scenario.expectation, row.decided
        if expectation is None or decided.window or is_control(decided.policy):
            continue
        met = expectation.met(decided.choice.participants, not row.infeasible)
        lines.append(
            (
                decided.scenario, expectation.words, decided.policy,
                ", ".join(decided.choice.participants) or "nobody", decided.choice.algorithm,
                "yes" if met else "no",
            )
        )  # fmt: skip
    return markdown(("scenario", "expected", "policy", "chosen", "algorithm", "as expected"), lines)
