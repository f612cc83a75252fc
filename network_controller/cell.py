"""One medium that several egos share: what each ego's link may have of it.

Links of their own would let N egos have N times what an access point carries. The capacity that
is wanted for their links is here that of all of them together, divided max-min fairly by what each
ego needs to reach Q_min; what is left over, in equal parts. So an ego that asks for ten times as
much as its part is held by its own link, and takes nothing from the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from network_controller.fairness import max_min

STEP = 0.1
"""Parts stay until one would change by more than this part of itself: needs move in every cycle,
and a link whose rate moves with them would have every ego decide anew."""


class Cell:
    """The parts of a shared cell; every part is the whole where it is not shared."""

    def __init__(self, egos: Sequence[str] = ()) -> None:
        """`egos`: those whose links are one medium; one ego shares with nobody."""
        self._parts = {ego: 1.0 / len(egos) for ego in egos} if len(egos) > 1 else {}

    def part(self, robot: str) -> float:
        """What a robot's link downwards may have of its wish, in (0, 1]."""
        return self._parts.get(robot, 1.0)

    def divide(self, capacity_bps: float, needs_bps: Mapping[str, float]) -> bool:
        """Divides a capacity by needs; an ego that says nothing needs nothing. Returns whether
        links have to change."""
        if not self._parts or capacity_bps <= 0.0:
            return False
        grants = max_min(capacity_bps, {ego: needs_bps.get(ego, 0.0) for ego in self._parts})
        # Everybody keeps enough to be heard: a tenth of an equal part.
        least = 0.1 / len(self._parts)
        parts = {ego: max(least, bps / capacity_bps) for ego, bps in grants.items()}
        total = sum(parts.values())
        parts = {ego: part / total for ego, part in parts.items()}
        if all(abs(parts[ego] - old) <= STEP * old for ego, old in self._parts.items()):
            return False
        self._parts = parts
        return True

    def grants(self, capacity_bps: int) -> dict[str, int]:
        """Each ego's part of a capacity; empty where nothing is shared."""
        return {ego: int(part * capacity_bps) for ego, part in self._parts.items()}
