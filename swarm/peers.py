"""Whether a router has the routers of other machines that it was given, and why not."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

from swarm.log import Logger
from swarm.reaching import why_not
from swarm.traffic import LINKS
from swarm.transport import TELL_S
from swarm.trust.identity import Identity

_END = re.compile(r"[a-z-]+/(?P<host>\[[^\]]+\]|[^:/]+):(?P<port>\d+)")


class Peers:
    """Says when one is linked, when it is lost, and every TELL_S why it is away."""

    def __init__(
        self,
        places: Sequence[str],
        identity: Identity | None,
        log: Logger,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """`places`: `tls/HOST:PORT` or `tcp/HOST:PORT` each."""
        self._identity = identity
        self._log = log
        self._now = now
        self._linked = dict.fromkeys(places, False)
        self._due = dict.fromkeys(places, now() + TELL_S / 2)

    def look(self, ends: Iterable[str]) -> None:
        """Takes the far ends of the links that there are."""
        found = [(m["host"].strip("[]"), int(m["port"])) for m in map(_END.match, ends) if m]
        for place in self._linked:
            up = _links(place, found)
            if (up > 0) != self._linked[place]:
                self._linked[place] = up > 0
                self._log.info("peer_linked" if up else "peer_lost", router=place, links=up)
                self._due[place] = self._now() + TELL_S / 2
            elif up == 0 and self._now() >= self._due[place]:
                self._due[place] = self._now() + TELL_S
                # On a thread of its own: where packets vanish it takes seconds.
                threading.Thread(target=self._tell, args=(place,), daemon=True).start()

    def _tell(self, place: str) -> None:
        why = why_not(place, self._identity) or "it does not answer"
        self._log.warning("peer_away", router=place, why=why)


def _links(place: str, ends: Sequence[tuple[str, int]]) -> int:
    """How many of the far ends are a router's, which has a port a traffic class."""
    match = _END.fullmatch(place)
    if match is None:
        return 0
    host, first = match["host"].strip("[]"), int(match["port"])
    hosts = {host}
    with suppress(OSError):
        hosts |= {str(info[4][0]) for info in socket.getaddrinfo(host, None)}
    return sum(end in hosts and first <= port < first + LINKS for end, port in ends)
