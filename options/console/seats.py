"""The egos that the console can show: each viewer chooses one, and looks at it from its seat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from options.console.board import Board, now_s
from options.console.hub import MAX_VIEWERS, Hub
from options.console.past import Past
from options.console.prometheus import Prometheus
from options.console.settings import ConsoleSettings
from options.console.view import View
from options.console.watch import Watch
from swarm.log import Logger


@dataclass(frozen=True, slots=True, eq=False)
class Seat:
    """What is shown of one ego, and who looks."""

    board: Board
    view: View
    watch: Watch
    hub: Hub
    past: Past | None
    """None where the swarm runs without Prometheus."""


class Seats:
    """A seat for each ego, taken when somebody first looks at it. Lives on one event loop."""

    def __init__(self, settings: ConsoleSettings, server: Prometheus | None, log: Logger) -> None:
        """Takes the seat of the first ego at once: its last minutes are known when a page opens."""
        self._settings = settings
        self._server = server
        self._log = log
        self._taken: dict[str, Seat] = {}
        self.egos: Sequence[str] = settings.egos or (settings.ego,)
        self.first = self._take(settings.ego)

    def of(self, ego: str) -> Seat | None:
        """The seat of an ego, of the first one for an empty name; None for a robot that does not
        decide."""
        name = ego or self._settings.ego
        if name not in self.egos:
            return None
        return self._taken.get(name) or self._take(name)

    @property
    def taken(self) -> Sequence[Seat]:
        """Those that somebody has looked at."""
        return tuple(self._taken.values())

    @property
    def viewers(self) -> int:
        """How many look."""
        return sum(seat.hub.viewers for seat in self._taken.values())

    def full(self) -> bool:
        """Whether nobody else may look."""
        return self.viewers >= MAX_VIEWERS

    def may_control(self, csrf: str) -> bool:
        """Whether this is the token of a page that is open now."""
        return any(seat.hub.may_control(csrf) for seat in self._taken.values())

    def tell_places(self) -> None:
        """Has every page ask anew for the site's places."""
        for seat in self.taken:
            seat.board.put("places", now_s())

    def _take(self, ego: str) -> Seat:
        settings, board = self._settings, Board()
        view = View(board, settings.swarm, ego, settings.comm_range_m)
        watch = Watch(view, settings.router, settings.swarm, ego, self._log)
        about = {"prometheus": settings.console_prometheus_link, "egos": self.egos}
        board.put("about", about)
        past = Past(self._server, ego) if self._server else None
        seat = self._taken[ego] = Seat(board, view, watch, Hub(board, watch.look), past)
        return seat
