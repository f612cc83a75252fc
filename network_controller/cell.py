"""One medium that several egos share: what each ego's link may have of it.

Links of their own would let N egos have N times what an access point carries. What is divided is
airtime, for a station that is far takes more of it for the same bits: each ego's rate is what its
link would carry if the medium were its own, and its guarantee is its part of the time at that
rate. Parts are max-min fair by what each ego needs to reach Q_min; what is left over, in equal
parts. What somebody leaves unused for a moment the others may have, up to their own rate.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from network_controller.fairness import max_min

STEP = 0.1
"""Parts stay until one would change by more than this part of itself: needs move in every cycle,
and a link whose rate moves with them would have every ego decide anew."""


class Cell:
    """The parts of a shared cell; every part is the whole where it is not shared."""

    def __init__(self, egos: Sequence[str] = ()) -> None:
        """`egos`: those whose links are one medium; one ego shares with nobody."""
        self._parts = {ego: 1.0 / len(egos) for ego in egos} if len(egos) > 1 else {}
        self._busy: frozenset[str] = frozenset(self._parts)
        self.lends = False
        """Whether links have what others leave unused for a moment."""

    @property
    def egos(self) -> tuple[str, ...]:
        """Those who share it; empty where nothing is shared."""
        return tuple(self._parts)

    def part(self, robot: str) -> float:
        """What a robot's link downwards may have of the time, in (0, 1]."""
        return self._parts.get(robot, 1.0)

    def divide(self, rates_bps: Mapping[str, float], needs_bps: Mapping[str, float]) -> bool:
        """Divides the time by needs, at the rates of the links that are shaped; an ego that says
        nothing needs nothing. Returns whether links have to change."""
        if not self._parts or not any(rates_bps.values()):
            return False
        needs = {
            ego: needs_bps.get(ego, 0.0) / rates_bps[ego] if rates_bps.get(ego) else 0.0
            for ego in self._parts
        }
        # Everybody keeps enough to be heard: a tenth of an equal part.
        least = 0.1 / len(self._parts)
        parts = {ego: max(least, part) for ego, part in max_min(1.0, needs).items()}
        total = sum(parts.values())
        parts = {ego: part / total for ego, part in parts.items()}
        if all(abs(parts[ego] - old) <= STEP * old for ego, old in self._parts.items()):
            return False
        self._parts = parts
        return True

    def use(self, busy: Collection[str]) -> bool:
        """Hears whose links carry something now. Returns whether that is news."""
        before, self._busy = self._busy, frozenset(busy) & self._parts.keys()
        return self._busy != before

    def carries_bps(self, rates_bps: Mapping[str, float]) -> int:
        """What the medium carries while those who use it have all of its time, each its part: less
        than the nearest station's rate when one that is far sends, too. Never less than an ego's
        part."""
        parts_bps = {ego: self._parts[ego] * bps for ego, bps in rates_bps.items() if bps}
        users = (self._busy & parts_bps.keys()) or parts_bps.keys()
        if not users:
            return 0
        time = sum(self._parts[ego] for ego in users)
        return round(max(sum(parts_bps[ego] for ego in users) / time, *parts_bps.values()))

    def grants(self, rates_bps: Mapping[str, float]) -> dict[str, int]:
        """Each ego's part of the time at its rate; empty where nothing is shared."""
        return {ego: int(part * rates_bps.get(ego, 0.0)) for ego, part in self._parts.items()}
