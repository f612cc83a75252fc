"""What of the published headline the published files support, in words and as a table."""

from __future__ import annotations

from collections.abc import Sequence

from research.evaluation.published import RATE_HZ, RULES, Cycle, Summary, summary
from research.evaluation.tables import markdown

HEADLINE_SAVED = 0.38
"""Share of bytes that the paper says are saved, at the precision of full participation."""
SAME_AP = 0.005
"""A smaller loss of AP counts as none."""


def report(makers: dict[str, list[Cycle]]) -> str:
    """The tables of means and of infeasible decisions, and what they say about the headline."""
    summaries = [summary(name, cycles) for name, cycles in makers.items()]
    infeasible = [
        (name, cycle) for name, cycles in makers.items() for cycle in cycles if cycle.infeasible
    ]
    parts = [_means(summaries), *map(_verdict, summaries)]
    total = sum(one.cycles for one in summaries)
    parts.append(
        f"\n{len(infeasible)} of {total} decisions need more than the link had, by the files' own "
        f"bytes and bandwidths at {RATE_HZ:g} frames a second:"
    )
    if infeasible:
        parts.append(_infeasible(infeasible))
    return "\n".join(parts)


def _means(summaries: Sequence[Summary]) -> str:
    return markdown(
        (
            "decided by", "cycles", "AP@0.3", "AP@0.5", "AP@0.7", "kB/frame", "everyone AP@0.7",
            "everyone kB/frame", "bytes saved", "answer s", "algorithms",
        ),
        [
            (
                one.name, one.cycles, f"{one.ap_30:.3f}", f"{one.ap_50:.3f}", f"{one.ap_70:.3f}",
                f"{one.bytes_per_frame / 1e3:.1f}", f"{one.everyone_ap_70:.3f}",
                f"{one.everyone_bytes_per_frame / 1e3:.1f}", f"{one.saved:.0%}",
                f"{one.response_s:.1f}",
                ", ".join(f"{name} {n}" for name, n in sorted(one.algorithms.items())),
            )
            for one in summaries
        ],
    )  # fmt: skip


def _verdict(one: Summary) -> str:
    if one.name == RULES and not one.fewer:
        return f"\n{one.name}: always everyone in range; it chooses the algorithm only."
    reached = "reaches" if one.saved >= HEADLINE_SAVED else "does not reach"
    if one.lost_ap_70.low > -SAME_AP:
        same = "at the same precision"
    elif one.lost_ap_70.high < 0:
        same = "at a loss of precision"
    else:
        same = "and its cycles are too few to tell whether precision is lost"
    return (
        f"\n{one.name}: left somebody out in {one.fewer} of {one.cycles} cycles. That saved "
        f"{one.saved:.0%} of the bytes of all vehicles in range with the same algorithm "
        f"(mean of the cycles' own shares: {one.paired_saved:.0%}), which {reached} the headline's "
        f"{HEADLINE_SAVED:.0%}, {same}: AP@0.7 {one.lost_ap_70} (95 % interval of paired cycles)."
    )


def _infeasible(cycles: Sequence[tuple[str, Cycle]]) -> str:
    return markdown(
        ("decided by", "scenario", "frame", "choice", "needs Mbit/s", "link Mbit/s"),
        [
            (
                name, cycle.scenario, cycle.frame,
                f"{cycle.chosen.algorithm}, {cycle.chosen.robots} vehicle(s)",
                f"{cycle.needs_bps / 1e6:.1f}", f"{cycle.bandwidth_bps / 1e6:.1f}",
            )
            for name, cycle in cycles
        ],
    )  # fmt: skip
