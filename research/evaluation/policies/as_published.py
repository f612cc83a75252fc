"""Policies and algorithms by two accountings of bytes: what is sent here, and what CoAdapt's
published results would count (windows/contents.py)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from research.evaluation.policies.controls import is_control
from research.evaluation.policies.results import Row
from research.evaluation.published import RATE_HZ
from research.evaluation.tables import markdown
from research.evaluation.windows.contents import Contents


@dataclass(frozen=True, slots=True)
class Accounts:
    """Means of one policy, or of one algorithm a participant, by both accountings."""

    of: str
    bytes_per_frame: float
    published_bytes_per_frame: float
    infeasible_ratio: float
    published_infeasible_ratio: float
    """Windows whose C(t) would not carry that at RATE_HZ."""


def by_policy(rows: Sequence[Row], held: Contents) -> list[Accounts]:
    """A row for each policy, in the order in which they first come; none for controls."""
    groups: dict[str, list[tuple[Row, float]]] = {}
    for row in (one for one in rows if not is_control(one.decided.policy)):
        groups.setdefault(row.decided.policy, []).append((row, _published(row, held)))
    return [_accounts(name, group, [1] * len(group)) for name, group in groups.items()]


def by_algorithm(rows: Sequence[Row], held: Contents) -> list[Accounts]:
    """A row for each algorithm: bytes a participant, over all choices, each once a window."""
    once = {
        (row.decided.scenario, row.decided.window, row.decided.choice): row
        for row in rows
        if row.decided.choice.participants
    }
    groups: dict[str, list[tuple[Row, float]]] = {}
    for row in once.values():
        own = groups.setdefault(row.decided.choice.algorithm, [])
        own.append((row, _published(row, held)))
    return [
        _accounts(name, group, [len(row.decided.choice.participants) for row, _ in group])
        for name, group in sorted(groups.items())
    ]


def _published(row: Row, held: Contents) -> float:
    decided = row.decided
    return held.bytes_as_published(decided.scenario, decided.window, decided.choice)


def _accounts(of: str, group: Sequence[tuple[Row, float]], shares: Sequence[int]) -> Accounts:
    def too_much(size: float, row: Row) -> bool:
        return size * 8 * RATE_HZ > row.capacity_bps

    own = [row.outcome.bytes_per_frame / n for (row, _), n in zip(group, shares, strict=True)]
    theirs = [size / n for (_, size), n in zip(group, shares, strict=True)]
    return Accounts(
        of=of,
        bytes_per_frame=float(np.mean(own)),
        published_bytes_per_frame=float(np.mean(theirs)),
        infeasible_ratio=float(np.mean([row.infeasible for row, _ in group])),
        published_infeasible_ratio=float(np.mean([too_much(size, row) for row, size in group])),
    )


def plain(rows: Sequence[Row], held: Contents) -> dict[str, list[dict[str, Any]]]:
    """Both tables as plain values."""
    return {
        "policies": [asdict(one) for one in by_policy(rows, held)],
        "algorithms": [asdict(one) for one in by_algorithm(rows, held)],
    }


def tables(rows: Sequence[Row], held: Contents) -> list[str]:
    """Both tables as Markdown."""
    return [
        _table("policy", by_policy(rows, held)),
        _table("algorithm, a participant", by_algorithm(rows, held)),
    ]


def _table(head: str, accounts: Sequence[Accounts]) -> str:
    return markdown(
        (head, "kB", "kB as published", "infeasible", "infeasible as published"),
        [
            (
                one.of, f"{one.bytes_per_frame / 1e3:.2f}",
                f"{one.published_bytes_per_frame / 1e3:.2f}", f"{one.infeasible_ratio:.0%}",
                f"{one.published_infeasible_ratio:.0%}",
            )
            for one in accounts
        ],
    )  # fmt: skip
