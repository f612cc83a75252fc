"""What every link should be now: the wish that counts, at the level that somebody needs."""

from __future__ import annotations

import math

from network_controller import ladder
from network_controller.cell import Cell
from network_controller.model import Link, LinkShape
from network_controller.slow_loop import SlowLoop
from network_controller.wishes import TRACE_FLOOR_BPS, Wish, Wishes
from swarm.process import Clock


class Targets:
    """Joins operators' wishes with the levels of the slow loop and of API sessions."""

    def __init__(
        self, wishes: Wishes, loop: SlowLoop, clock: Clock, cell: Cell | None = None
    ) -> None:
        self._cell = cell or Cell()
        self._wishes = wishes
        self._loop = loop
        self._clock = clock
        self._holds: dict[str, tuple[Link, int]] = {}

    def shapes(self) -> dict[Link, LinkShape]:
        """The shape of every link that should have one."""
        now_ns = self._clock.now_ns()
        return {wish.link: self._shape(wish, now_ns) for wish in self._wishes}

    def cell_rates_bps(self) -> dict[str, int]:
        """What each link of the shared cell would have now if it were alone there; those that
        nobody wants shaped are left out."""
        return self._cell_rates_bps(self._clock.now_ns())

    def level(self, link: Link) -> int:
        """What the slow loop says, or a session that needs more."""
        held = [level for held, level in self._holds.values() if held == link]
        return max([self._loop.level(link), *held])

    def held(self, session_id: str) -> tuple[Link, int] | None:
        """The link and the level that a session holds."""
        return self._holds.get(session_id)

    def hold(self, session_id: str, holding: tuple[Link, int] | None) -> None:
        """Has a session hold a level of a link, or nothing."""
        if holding is None:
            self._holds.pop(session_id, None)
        else:
            self._holds[session_id] = holding

    def next_change_s(self) -> float:
        """Seconds until a shape changes by itself; infinity: never."""
        now_ns = self._clock.now_ns()
        changes = [wish.next_change_ns(now_ns) for wish in self._wishes]
        return (min(changes, default=math.inf) - now_ns) / 1e9

    def _shape(self, wish: Wish, now_ns: int) -> LinkShape:
        level = self.level(wish.link)
        rate_bps = wish.rate_bps(now_ns)
        shared = wish.direction == "down" and wish.robot in self._cell.egos
        part_bps = max(TRACE_FLOOR_BPS, int(rate_bps * self._cell.part(wish.robot)))
        lent = shared and self._cell.lends
        return ladder.shape(
            part_bps if shared else rate_bps,
            level,
            delay_ms=wish.delay_ms,
            loss=wish.loss,
            ceil_bps=rate_bps if lent else 0,
            cell_bps=self._cell_bps(now_ns) if lent else 0,
        )

    def _cell_bps(self, now_ns: int) -> int:
        return max(TRACE_FLOOR_BPS, self._cell.carries_bps(self._cell_rates_bps(now_ns)))

    def _cell_rates_bps(self, now_ns: int) -> dict[str, int]:
        wishes = ((ego, self._wishes.get(Link(ego, "down"))) for ego in self._cell.egos)
        return {ego: wish.rate_bps(now_ns) for ego, wish in wishes if wish is not None}
