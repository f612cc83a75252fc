"""What a router tells egos of its connections to them."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

import zenoh

from swarm import keyspace
from swarm.messages import Backlog, TcpState, encode
from swarm.tcp.watch import TcpWatch
from swarm.traffic import TrafficClass

NEWS_BYTES = 5_000
"""A connection that has carried less since it was told of, and stood not, shows nothing."""
MAX_PEERS = 256


class TcpReporter:
    """Publishes how a router's connections of the fusion class are doing, until closed."""

    def __init__(
        self,
        session: zenoh.Session,
        swarm: str,
        on_seen: Callable[[Mapping[str, Backlog]], None] = lambda seen: None,
    ) -> None:
        """`on_seen(seen)` hears of all connections, twice a second."""
        self._on_seen = on_seen
        self._session = session
        self._key = keyspace.net_tcp(swarm)
        self._number = random.getrandbits(48)
        self._seq = 0
        self._told: dict[str, Backlog] = {}
        self._watch = TcpWatch(on_look=self._report)

    def close(self) -> None:
        """Publishes no more."""
        self._watch.close()

    def _report(self, seen: Mapping[str, Backlog]) -> None:
        self._on_seen(seen)
        news = {peer: now for peer, now in seen.items() if self._is_news(peer, now)}
        self._told = {peer: now for peer, now in (self._told | news).items() if peer in seen}
        if not news:
            return
        self._seq += 1
        state = TcpState(
            router=self._number,
            seq=self._seq,
            sent_ns=time.time_ns(),
            peers=dict(list(news.items())[:MAX_PEERS]),
        )
        # Zenoh closes the session on another thread when the process ends.
        with suppress(zenoh.ZError):
            self._session.put(
                self._key,
                encode(state),
                priority=TrafficClass.CONTROL.priority,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )

    def _is_news(self, peer: str, now: Backlog) -> bool:
        before = self._told.get(peer, Backlog())
        return now.stood_ms > before.stood_ms or now.sent_bytes - before.sent_bytes >= NEWS_BYTES
