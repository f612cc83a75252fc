"""What network controllers say of the links (`net/state`), as far as an ego is concerned.

There is one controller a host, and each speaks for the links that it has shaped. A link that its
own controller no longer mentions is unshaped; that another one does not mention it means nothing.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass, field

from ego_agent.link import LinkEstimate
from swarm.messages import Direction, LinkState, NetState

STEADY_S = 3.0
"""While a link's configuration stays the same, the least that was available in this time counts:
telemetry that comes and goes each second must not make decisions come and go with it. What is
configured anew counts at once, up and down."""
MAX_CONTROLLERS = 64
MAX_LINKS = 1024

_Link = tuple[str, Direction]


@dataclass(slots=True)
class _Word:
    """What was said last of one link."""

    controller: int
    configured: tuple[int, int] = (0, 0)
    """Capacity and level."""
    recent: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=16))
    """When, and bit/s that this ego could have."""


class LinkWatch:
    """Passes on to the estimate what controllers say of the ego's cell and the robots' up-links.

    Not thread-safe: its owner calls it from one thread at a time.
    """

    def __init__(self, ego: str, link: LinkEstimate) -> None:
        self._ego = ego
        self._link = link
        self._seqs: OrderedDict[int, int] = OrderedDict()
        self._words: dict[_Link, _Word] = {}

    def take(self, state: NetState, now_s: float) -> bool:
        """Takes a state; False where it is no newer than the last one of its controller."""
        if state.seq <= self._seqs.get(state.controller, -1):
            return False
        self._seqs[state.controller] = state.seq
        self._seqs.move_to_end(state.controller)
        if len(self._seqs) > MAX_CONTROLLERS:
            self._seqs.popitem(last=False)
        heard: set[_Link] = set()
        for link in state.links:
            if link.direction == "up" or link.robot == self._ego:
                heard.add((link.robot, link.direction))
                self._hear(state.controller, link, now_s)
        for name, word in list(self._words.items()):
            if word.controller == state.controller and name not in heard:
                del self._words[name]
                self._pass_on(name, None, now_s)
        return True

    def _hear(self, controller: int, link: LinkState, now_s: float) -> None:
        name: _Link = (link.robot, link.direction)
        word = self._words.get(name)
        if word is None or word.controller != controller:
            if word is None and len(self._words) >= MAX_LINKS and link.robot != self._ego:
                return
            word = self._words[name] = _Word(controller)
        if word.configured != (link.capacity_bps, link.level):
            word.configured = (link.capacity_bps, link.level)
            word.recent.clear()
        granted_bps = link.grants.get(self._ego, link.available_bps)
        word.recent.append((now_s, min(link.available_bps, granted_bps)))
        least = min(bps for at, bps in word.recent if now_s - at <= STEADY_S)
        self._pass_on(name, float(least), now_s)

    def _pass_on(self, name: _Link, bps: float | None, now_s: float) -> None:
        if name == (self._ego, "down"):
            if bps is None:
                self._link.clear_state()
            else:
                self._link.set_state(bps, now_s)
        elif name[1] == "up" and name[0] != self._ego:
            self._link.set_uplink(name[0], bps, now_s)
