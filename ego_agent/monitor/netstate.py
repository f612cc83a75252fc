"""What network controllers (`net/state`) and routers (`net/tcp`) say of the links, as far as an ego
is concerned.

There is one controller a host, and each speaks for the links that it has shaped. A link that its
own controller no longer mentions is unshaped; that another one does not mention it means nothing,
and what another one says of it counts only once its own has been silent (`FRESH_S`). A
router tells of the queues of its sockets; an ego knows its own by their addresses.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from ego_agent.knowledge.control_share import control_bps
from ego_agent.monitor.evidence import MIN_STOOD_MS, Queues
from ego_agent.monitor.link import LinkEstimate
from swarm.controllers import FRESH_S
from swarm.messages import Direction, LinkState, NetState, TcpState
from swarm.tcp.info import connections
from swarm.traffic import TrafficClass

STEADY_S = 3.0
"""While a link's configuration stays the same, the least that was available in this time counts:
telemetry that comes and goes each second must not make decisions come and go with it. What is
configured anew counts at once, up and down."""
SETTLING_S = 5.0
"""After a link was configured anew, control traffic that is more than robots may take there is
about to become less: in the next cycle the ego tells them so."""
MIN_ROBOTS = 2
"""The ego and one that tells it of itself."""
IDLE = 0.02
"""Share of a link below which a class takes nothing of it."""
MAX_SENDERS = 64
"""Controllers and routers whose messages are counted; the longest unheard is dropped."""
MAX_LINKS = 1024

_Link = tuple[str, Direction]


@dataclass(slots=True)
class _Word:
    """What was said last of one link."""

    controller: int
    name: str = ""
    at: float = 0.0
    """When."""
    configured: tuple[int, int] = (0, 0)
    """Capacity and level."""
    since: float = 0.0
    """When that capacity was first said."""
    recent: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=16))
    """When, and bit/s that this ego could have."""
    stood_ms: int | None = None
    """Counter of fusion's queue."""

    def stood(self, link: LinkState) -> bool:
        """Whether fusion's queue has stood since the last word."""
        before, self.stood_ms = self.stood_ms, None
        if "fusion" in link.classes:
            self.stood_ms = link.classes["fusion"].backlog.stood_ms
        if before is None or self.stood_ms is None:
            return False
        return self.stood_ms - before >= MIN_STOOD_MS


def own_addresses() -> frozenset[str]:
    """This process's ends of its connections of the fusion class."""
    return frozenset(c.local for c in connections(TrafficClass.FUSION))


class LinkWatch:
    """Passes on to the estimate what is said of the ego's cell and the robots' up-links.

    Not thread-safe: its owner calls it from one thread at a time.
    """

    def __init__(
        self,
        ego: str,
        link: LinkEstimate,
        own: Callable[[], Collection[str]] = own_addresses,
        robots: Callable[[], int] = lambda: 0,
    ) -> None:
        """`robots`: how many are alive, the ego among them; 0 where that is not known."""
        self._ego = ego
        self._link = link
        self._own = own
        self._robots = robots
        self._mine: Collection[str] = ()
        self._queues = Queues()
        self._seqs: OrderedDict[int, int] = OrderedDict()
        self._words: dict[_Link, _Word] = {}

    def take(self, state: NetState, now_s: float) -> bool:
        """Takes a state; False where it is no newer than the last one of its controller."""
        if not self._newer(state.controller, state.seq):
            return False
        heard: set[_Link] = set()
        for link in state.links:
            if link.direction == "up" or link.robot == self._ego:
                heard.add((link.robot, link.direction))
                self._hear(state, link, now_s)
        for name, word in list(self._words.items()):
            if word.controller == state.controller and name not in heard:
                del self._words[name]
                self._pass_on(name, None, now_s)
        return True

    def take_tcp(self, state: TcpState, now_s: float) -> bool:
        """Takes a router's word; False where it is no newer than its last one."""
        if not self._newer(state.router, state.seq):
            return False
        if not any(peer in state.peers for peer in self._mine):
            self._mine = self._own()  # Also where a connection was lost and is a new one.
        for peer in self._mine:
            if peer in state.peers:
                sample = self._queues.take((state.router, peer), state.peers[peer])
                if sample is not None:
                    self._link.add_cell(sample, now_s)
        return True

    def _newer(self, sender: int, seq: int) -> bool:
        if seq <= self._seqs.get(sender, -1):
            return False
        self._seqs[sender] = seq
        self._seqs.move_to_end(sender)
        if len(self._seqs) > MAX_SENDERS:
            self._seqs.popitem(last=False)
        return True

    def _hear(self, state: NetState, link: LinkState, now_s: float) -> None:
        name: _Link = (link.robot, link.direction)
        word = self._words.get(name)
        if word is None or word.controller != state.controller:
            if word is None and len(self._words) >= MAX_LINKS and link.robot != self._ego:
                return
            if word is not None and word.name != state.name and now_s - word.at <= FRESH_S:
                return  # Another host's controller has this link.
            word = self._words[name] = _Word(state.controller, state.name)
        word.at = now_s
        if word.configured != (link.capacity_bps, link.level):
            if word.configured[0] != link.capacity_bps:
                word.since = now_s
            word.configured = (link.capacity_bps, link.level)
            word.recent.clear()
        available_bps = link.available_bps
        if name == (self._ego, "down") and now_s - word.since <= SETTLING_S:
            available_bps = max(available_bps, self._soon_bps(link))
        share = link.grants.get(self._ego, link.available_bps) / max(1, link.available_bps)
        word.recent.append((now_s, round(available_bps * min(1.0, share))))
        least = min(bps for at, bps in word.recent if now_s - at <= STEADY_S)
        self._pass_on(name, float(least), now_s, stood=word.stood(link))

    def _soon_bps(self, link: LinkState) -> int:
        """What fusion has of the cell when robots keep to what they may take there; 0 where that is
        not known."""
        background, robots = link.classes.get("background"), self._robots()
        if background is None or robots < MIN_ROBOTS:
            return 0
        if background.throughput_bps > IDLE * link.capacity_bps or background.backlog_bytes:
            return 0
        return round(link.capacity_bps - control_bps(link.capacity_bps, robots))

    def _pass_on(
        self, name: _Link, bps: float | None, now_s: float, *, stood: bool = False
    ) -> None:
        if name == (self._ego, "down"):
            if bps is None:
                self._link.clear_state(now_s)
            else:
                self._link.set_state(bps, now_s, stood=stood)
        elif name[1] == "up" and name[0] != self._ego:
            self._link.set_uplink(name[0], bps, now_s, stood=stood)
