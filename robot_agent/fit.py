"""What egos say of how a robot fits: what keeps it from being chosen stands in its own log, too."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable

from swarm.fitting import other_world
from swarm.log import Logger
from swarm.messages import NetDemand
from swarm.tcp.stuck import Way, stuck

UNHEARD_S = 10.0
"""An ego speaks every second or five; a robot that hears none for so long says so."""
AGAIN_S = 60.0
"""And says it again this often."""
MOVED_WORDS = 3
"""So many words of one ego in a row, and its world is another one now."""
MAX_TOLD = 256


class Fit:
    """Logs each thing once, until another one is said. `on_demand` runs on Zenoh's threads, `look`
    on one other."""

    def __init__(
        self,
        robots: Iterable[str],
        mark: str,
        where: str,
        log: Logger,
        on_moved: Callable[[str], object] | None = None,
        now: Callable[[], float] = time.monotonic,
        stuck: Callable[[], str] = stuck,
    ) -> None:
        """`mark`: of this process's world. `where`: swarm and router, in words. `on_moved`: hears,
        in words, that an ego lives in another world now. `stuck` tells why nothing gets through."""
        self._robots = tuple(robots)
        self._mark = mark
        self._where = where
        self._log = log
        self._on_moved = on_moved
        self._now = now
        self._way = Way(log, stuck, now)
        self._lock = threading.Lock()
        self._told: dict[tuple[str, str], str] = {}
        self._quiet_since = now()
        self._said_at = float("-inf")
        self._moved: dict[str, int] = {}
        """Words in a row of an ego from another world."""

    def on_demand(self, demand: NetDemand) -> None:
        """Takes an ego's word."""
        with self._lock:
            if self._said_at > self._quiet_since:
                self._log.info("ego_heard", ego=demand.ego)
            self._quiet_since = self._now()
            elsewhere = other_world(demand.world, self._mark)
            if self._on_moved is not None:
                words = self._moved[demand.ego] = (
                    self._moved.get(demand.ego, 0) + 1 if elsewhere else 0
                )
                if words == MOVED_WORDS:
                    self._on_moved(f"ego {demand.ego} was started anew: {elsewhere}")
            for robot in self._robots:
                why = demand.told.get(robot, elsewhere)
                key = (demand.ego, robot)
                if self._told.get(key, "") == why or robot == demand.ego:
                    continue
                if len(self._told) < MAX_TOLD or key in self._told:
                    self._told[key] = why
                    self._tell(demand.ego, robot, why)

    def look(self) -> None:
        """Says that no ego is heard, or that what is sent does not get through."""
        with self._lock:
            now = self._now()
            self._way.look()
            if now - self._quiet_since >= UNHEARD_S and now - self._said_at >= AGAIN_S:
                self._said_at = now
                why = f"no ego is heard in {self._where}: the swarm may have another name"
                self._log.warning("no_ego", why=why)

    def _tell(self, ego: str, robot: str, why: str) -> None:
        if why:
            self._log.warning("ego_says", robot=robot, ego=ego, why=f"{robot}: {why}")
        else:
            self._log.info("ego_says", robot=robot, ego=ego, why=f"{robot} fits again")
