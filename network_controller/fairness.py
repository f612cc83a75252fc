"""Sharing one link between several egos."""

from __future__ import annotations

from collections.abc import Mapping


def max_min(capacity: float, demands: Mapping[str, float]) -> dict[str, float]:
    """The max-min fair division of a capacity: nobody gets more by taking from one who has less.

    Whoever needs less than an equal part gets what it needs, and the others share the rest; what
    is left when all have what they need is shared equally. (Bertsekas and Gallager, "Data
    Networks", 2nd ed., section 6.5.2, on a single link.)
    """
    grants: dict[str, float] = {}
    left = max(0.0, capacity)
    waiting = sorted(demands, key=lambda ego: (demands[ego], ego))
    for position, ego in enumerate(waiting):
        grants[ego] = min(max(0.0, demands[ego]), left / (len(waiting) - position))
        left -= grants[ego]
    return {ego: grant + left / len(demands) for ego, grant in grants.items()}
