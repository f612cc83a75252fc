"""Whether full packets vanish on the way while small ones pass: an MTU that is not what it says."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from swarm.log import Logger
from swarm.tcp.info import TcpInfo, connections, tcp_info
from swarm.traffic import TrafficClass

STUCK_BACKOFF = 4
"""After so many times in a row, each twice as long, seconds have passed without a single packet's
acknowledgement: no loss by chance."""
HEARD_MS = 3_000
"""Who was heard within this time is there: Zenoh speaks every 2.5 s."""

LOOK_S, AGAIN_S = 2.0, 60.0
"""How often it is looked, and how often said."""


def stuck() -> str:
    """In words, that what this process sends does not get through though the other end is heard;
    empty where that is not so."""
    return why(
        (one.peer, info)
        for cls in TrafficClass
        for one in connections(cls)
        if (info := tcp_info(one.descriptor)) is not None
    )


def why(found: Iterable[tuple[str, TcpInfo]]) -> str:
    """The same of these connections, by the other end's address and port."""
    for peer, info in found:
        if info.backoff >= STUCK_BACKOFF and info.heard_ms <= HEARD_MS:
            return (
                f"packets of {info.segment_bytes} bytes do not get through to {peer}, which is "
                "heard all the same: the way's MTU is smaller than this machine's "
                f"(`ping -M do -s {info.segment_bytes} {peer.rpartition(':')[0]}` tells)"
            )
    return ""


class Way:
    """Says where that is so, now and then; `look` belongs to one thread."""

    def __init__(
        self,
        log: Logger,
        stuck: Callable[[], str] = stuck,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._log = log
        self._stuck = stuck
        self._now = now
        self._due = now() + LOOK_S

    def look(self) -> None:
        """Looks, where that is due."""
        now = self._now()
        if now < self._due:
            return
        told = self._stuck()
        self._due = now + (AGAIN_S if told else LOOK_S)
        if told:
            self._log.warning("way_stuck", why=told)
