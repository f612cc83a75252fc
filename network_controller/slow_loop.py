"""The slow loop: moves bandwidth towards fusion when decisions alone cannot reach Q_min.

Egos say what the cheapest decision that reaches Q_min needs (`net/demand`). A shortfall that lasts
for `windows` windows in a row raises the link by one level of the ladder; ease that lasts as long
lowers it by one. A window is short when the need was more than the link can give fusion at its
every tick, and easy when the level below would have done with `MARGIN` to spare at every tick;
what is neither starts both counts again. So an action changes the network at most once in
`windows * window_s`, and a load that sits at a boundary moves nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from network_controller import ladder
from network_controller.model import Link
from swarm.messages import NetDemand

MARGIN = 0.10
"""The level below must leave this much of its bandwidth free: the hysteresis."""
DEMAND_FRESH_S = 12.0
"""An older demand is none: two and a half of the paper's 5 s control cycles."""
MAX_EGOS = 128


@dataclass(frozen=True, slots=True)
class Load:
    """What went through a link in the last tick."""

    capacity_bps: int
    control_bps: float
    background_bps: float
    """What background wants: infinity while it has a backlog."""


@dataclass(frozen=True, slots=True)
class Action:
    """One step of one link, and why."""

    link: Link
    before: int
    after: int
    reason: str


@dataclass(slots=True)
class _Window:
    began_s: float | None = None
    short: bool = True
    easy: bool = True
    shorts: int = 0
    """Short windows in a row."""
    eases: int = 0


@dataclass(slots=True)
class SlowLoop:
    """Levels of links, as far as this loop sets them. Times are `time.monotonic()` seconds."""

    window_s: float = 5.0
    windows: int = 3
    levels: dict[Link, int] = field(default_factory=dict)
    _demands: dict[str, tuple[NetDemand, float]] = field(default_factory=dict)
    _windows: dict[Link, _Window] = field(default_factory=dict)

    def on_demand(self, demand: NetDemand, now_s: float) -> None:
        """Takes an ego's demand; the newest one counts."""
        if demand.ego in self._demands or len(self._demands) < MAX_EGOS:
            self._demands[demand.ego] = (demand, now_s)

    def demands(self, now_s: float) -> dict[str, NetDemand]:
        """The fresh demands, by ego."""
        self._demands = {
            ego: (demand, at)
            for ego, (demand, at) in self._demands.items()
            if now_s - at <= DEMAND_FRESH_S
        }
        return {ego: demand for ego, (demand, _) in self._demands.items()}

    def level(self, link: Link) -> int:
        """The level of a link."""
        return self.levels.get(link, 0)

    def forget(self, link: Link) -> None:
        """A link is not shaped any more, or another one: it starts at level 0 again."""
        self.levels.pop(link, None)
        self._windows.pop(link, None)

    def tick(self, loads: Mapping[Link, Load], now_s: float) -> tuple[Action, ...]:
        """Looks at all links towards egos; returns the steps to take, one a link at most.

        The caller carries them out and reports back with `done`.
        """
        actions = []
        demands = self.demands(now_s)
        for link, load in loads.items():
            demand = demands.get(link.robot) if link.direction == "down" else None
            action = self._look(link, load, demand, now_s)
            if action is not None:
                actions.append(action)
        return tuple(actions)

    def done(self, action: Action) -> None:
        """The step was taken."""
        self.levels[action.link] = action.after

    def _look(
        self, link: Link, load: Load, demand: NetDemand | None, now_s: float
    ) -> Action | None:
        window = self._windows.setdefault(link, _Window())
        if window.began_s is None:
            window.began_s = now_s
        level = self.level(link)
        needed = 8.0 * demand.needed_bytes_s if demand is not None else 0.0
        short = demand is not None and demand.unreachable_s > 0.0 and needed > _gives(load, level)
        easy = level > 0 and needed <= (1.0 - MARGIN) * _gives(load, level - 1)
        window.short &= short
        window.easy &= easy
        if now_s - window.began_s < self.window_s:
            return None
        window.shorts = window.shorts + 1 if window.short else 0
        window.eases = window.eases + 1 if window.easy else 0
        window.began_s, window.short, window.easy = now_s, True, True
        if window.shorts >= self.windows and level < ladder.TOP:
            window.shorts = 0
            return Action(link, level, level + 1, self._why_up(load, level, demand))
        if window.eases >= self.windows:
            window.eases = 0
            return Action(link, level, level - 1, self._why_down(load, level, demand))
        return None

    def _why_up(self, load: Load, level: int, demand: NetDemand | None) -> str:
        assert demand is not None  # a window without a demand is not short
        step = (
            "fusion goes before background"
            if level == 0
            else "guaranteed rate moves from background to fusion"
        )
        return (
            f"{demand.ego} needs {8 * demand.needed_bytes_s / 1e6:.2f} Mbit/s to reach Q_min "
            f"{demand.q_min:.2f} and had {_gives(load, level) / 1e6:.2f} of "
            f"{load.capacity_bps / 1e6:.2f} for {self.windows} windows of {self.window_s:g} s; "
            f"{step}: {_gives(load, level + 1) / 1e6:.2f} Mbit/s"
        )

    def _why_down(self, load: Load, level: int, demand: NetDemand | None) -> str:
        need = (
            "nobody asks for more"
            if demand is None
            else f"{demand.ego} needs {8 * demand.needed_bytes_s / 1e6:.2f} Mbit/s"
        )
        return (
            f"{need}, and the level below gives {_gives(load, level - 1) / 1e6:.2f} of "
            f"{load.capacity_bps / 1e6:.2f} Mbit/s for {self.windows} windows of "
            f"{self.window_s:g} s"
        )


def _gives(load: Load, level: int) -> int:
    """Bit/s for fusion at a level under a load."""
    return ladder.available_bps(load.capacity_bps, level, load.control_bps, load.background_bps)
