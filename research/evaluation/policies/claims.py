"""What the comparison must show, and whether it does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import isnan
from typing import Any

import numpy as np

from research.evaluation.bootstrap import Interval
from research.evaluation.policies.beside import BETTER, Comparison, beside_controls
from research.evaluation.policies.results import Means, Row

MAX_LOST_AP = 0.005
MIN_SAVED = 0.80
EVERYONE = "static-early"
MIN_FEWER, MIN_FEWER_BYTES, MIN_LESS_COMPUTE = 0.25, 0.40, 0.30
MAX_REGRET = 0.02
MAX_DECISION_MS = {6: 50.0, 50: 200.0}
"""By the number of robots: in swarms of so many at most, and more than the size before."""
ADAPTIVE = ("coverage", "surrogate")


@dataclass(frozen=True, slots=True)
class Claim:
    """A figure beside its target."""

    what: str
    value: float
    target: str
    met: bool


def claims_of(means: Sequence[Means], rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The claims that can be judged with these policies and scenarios, as plain values."""
    known = {one.policy: one for one in means}
    beaten = _better(beside_controls(rows))
    found = (*_claims(known), *_feasible(rows), *beaten, *_quick(rows))
    return [asdict(claim) for claim in found]


def _better(compared: Sequence[Comparison]) -> Iterator[Claim]:
    """That policies are worth more than their controls."""
    for one in compared:
        low = one.value.low
        yield Claim(
            f"{one.policy}: better than {one.words}, lower end of the interval of value",
            round(low, 4), "> 0", one.verdict(one.value) == BETTER,
        )  # fmt: skip


def _quick(rows: Sequence[Row]) -> Iterator[Claim]:
    """How long decisions of the adaptive policies take, by the size of the swarm."""
    for name in ADAPTIVE:
        fewer = 0
        for robots, most_ms in MAX_DECISION_MS.items():
            took_ms = [
                1e3 * row.decided.decision_s
                for row in rows
                if row.decided.policy == name and fewer < row.scenario.robots <= robots
            ]
            fewer = robots
            if took_ms:
                p99 = float(np.percentile(took_ms, 99))
                yield Claim(
                    f"{name}: decision p99 up to {robots} robots, ms",
                    round(p99, 2), f"<= {most_ms:g}", p99 <= most_ms,
                )  # fmt: skip


def _claims(known: dict[str, Means]) -> Iterator[Claim]:
    for name in ADAPTIVE:
        if name not in known:
            continue
        one = known[name]
        yield from _little_lost(
            f"{name}: AP@0.7 below the best static full participation", one.lost_ap_70
        )
        if not isnan(one.saved):
            yield Claim(
                f"{name}: share of its bytes saved",
                round(one.saved, 4), f">= {MIN_SAVED}", one.saved >= MIN_SAVED,
            )  # fmt: skip
        yield from _little_lost(
            f"{name}: AP@0.7 below full participation where the link carries that",
            one.lost_where_it_fits,
        )
        yield from _little_lost(
            f"{name}: delivered AP@0.7 below the best that full participation delivers",
            one.lost_delivered,
        )
        if EVERYONE in known:
            yield from _saved(one, known[EVERYONE])
    if "surrogate" in known:
        regret = known["surrogate"].regret_mean
        yield Claim(
            "surrogate: mean regret", round(regret, 4), f"<= {MAX_REGRET}", regret <= MAX_REGRET
        )
    for name, one in known.items():
        # Without an answer a language model's policy is coverage's.
        if one.answered_ratio:
            answers = f"with answers in {one.answered_ratio:.0%} of windows"
            yield from _little_lost(
                f"{name}: AP@0.7 below coverage, {answers}", one.lost_to_coverage
            )


def _saved(one: Means, everyone: Means) -> Iterator[Claim]:
    """What a policy saves of what everyone with points takes. How its delivered precision compares
    is a claim of its own."""
    for what, ours, theirs, least in (
        ("participants", one.participants_mean, everyone.participants_mean, MIN_FEWER),
        ("bytes", one.bytes_per_frame, everyone.bytes_per_frame, MIN_FEWER_BYTES),
        ("the ego's compute", one.ego_ms_per_frame, everyone.ego_ms_per_frame, MIN_LESS_COMPUTE),
    ):
        if theirs > 0:
            saved = 1 - ours / theirs
            yield Claim(
                f"{one.policy}: share of {what} saved, beside everyone with early",
                round(saved, 4), f">= {least}", saved >= least,
            )  # fmt: skip


def _feasible(rows: Sequence[Row]) -> Iterator[Claim]:
    """That no window is infeasible whose link the ego is told of, and not one that was recorded:
    there it knows the past."""
    for name in ADAPTIVE:
        told = [r for r in rows if r.decided.policy == name and r.scenario.link.lag_s == 0.0]
        if told:
            ratio = float(np.mean([row.infeasible for row in told]))
            yield Claim(
                f"{name}: share of infeasible windows of {len(told)} on shaped links",
                round(ratio, 4), "0", ratio == 0,
            )  # fmt: skip


def _little_lost(what: str, gained: Interval) -> Iterator[Claim]:
    """That no more than MAX_LOST_AP is lost, where there was something to compare with."""
    lost = -gained.mean
    if not isnan(lost):
        yield Claim(what, round(lost, 4), f"<= {MAX_LOST_AP}", lost <= MAX_LOST_AP)
