"""Policies beside their controls: paired differences, and whether a policy is better."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from research.evaluation.bootstrap import Interval, bootstrap_mean
from research.evaluation.policies.controls import AT_RANDOM, FIRST, RANDOM_JUDGED, is_control
from research.evaluation.policies.results import Row, pairs
from research.evaluation.tables import markdown

LLM = "llm-"
"""What names of policies that ask a language model begin with."""
BETTER = "better"
LEAST_GROUPS = 5
"""A bootstrap draws whole groups again: of one it gives a point, of few a narrow interval."""
WORDS = {
    AT_RANDOM: "random choices of as many",
    FIRST: "the first of as many by coverage",
    RANDOM_JUDGED: "random choices that are judged alike",
}
"""What each control is."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One policy less one of its controls, in the same windows."""

    policy: str
    control: str
    """The control's name among the policies."""
    words: str
    """What the control is."""
    windows: int
    differing: int
    """Windows in which the control chose others."""
    groups: int
    """Floors or recordings that these come from."""
    delivered_ap_70: Interval
    value: Interval

    def plain(self) -> dict[str, Any]:
        """The same as plain values, with a verdict on each difference."""
        return {
            **asdict(self),
            "delivered_verdict": self.verdict(self.delivered_ap_70),
            "value_verdict": self.verdict(self.value),
        }

    def verdict(self, gained: Interval) -> str:
        """`better` or `worse` only where the interval excludes 0, else `no better`; of fewer groups
        than LEAST_GROUPS an interval says nothing."""
        if self.groups < LEAST_GROUPS:
            return "too few to tell"
        if gained.low > 0:
            return BETTER
        return "worse" if gained.high < 0 else "no better"


def beside_controls(rows: Sequence[Row]) -> list[Comparison]:
    """Every policy with every control of it that is among the rows."""
    by_policy: dict[str, list[Row]] = {}
    for row in rows:
        by_policy.setdefault(row.decided.policy, []).append(row)
    return [
        _compared(policy, control, kind, by_policy)
        for policy in by_policy
        if not is_control(policy)
        for control, kind in _controls(policy)
        if control in by_policy
    ]


def _controls(policy: str) -> Iterator[tuple[str, str]]:
    """The names that its controls would have, and their kinds."""
    yield f"{policy}{AT_RANDOM}", AT_RANDOM
    yield f"{policy}{FIRST}", FIRST
    if policy.startswith(LLM):
        yield RANDOM_JUDGED, RANDOM_JUDGED


def _compared(
    policy: str, control: str, kind: str, by_policy: Mapping[str, Sequence[Row]]
) -> Comparison:
    found = pairs(by_policy[policy], by_policy[control])
    groups = [row.scenario.group for row, _ in found]

    def gained(what: Callable[[Row], float]) -> Interval:
        return bootstrap_mean([what(row) - what(other) for row, other in found], groups)

    return Comparison(
        policy=policy,
        control=control,
        words=WORDS[kind],
        windows=len(found),
        differing=sum(row.decided.choice != other.decided.choice for row, other in found),
        groups=len(set(groups)),
        delivered_ap_70=gained(lambda row: row.delivered_ap_70),
        value=gained(lambda row: row.value),
    )


def controls_table(compared: Sequence[Comparison]) -> str:
    """A line a policy and control, as Markdown."""
    return markdown(
        ("policy", "control", "others chosen", "delivered AP@0.7", "verdict", "value", "verdict"),
        [
            (
                one.policy, one.words, f"{one.differing}/{one.windows}",
                str(one.delivered_ap_70), one.verdict(one.delivered_ap_70),
                str(one.value), one.verdict(one.value),
            )
            for one in compared
        ],
    )  # fmt: skip
