"""Which of two egos decides: the first one, or the one that stands in for it.

Each shows by a liveliness token that it leads. The first one is always right: it leads as soon as
it has its picture, and the standby only while nobody hears of the first.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from swarm import keyspace
from swarm.errors import TransportError
from swarm.log import Logger
from swarm.messages import Decision
from swarm.session import Session

GONE_S = 0.3
"""A first ego whose token is away for so long has ended. A router that ends takes all tokens with
it, too, but then there are no links either."""
SILENT_S = 3.0
PERIODS = 3
"""A first ego that hangs keeps its token: it is gone when so many of its decisions are missing, and
SILENT_S at least."""
FIRST_S = 10.0
"""How long a standby that starts waits for a first ego that it has never heard."""
AGAIN_S = 1.0
"""Added to its patience with a first ego that hangs, once a router that was away is back: the first
looks, too, before it speaks."""
HEAR_S = 0.5
"""How long a first ego that comes to the router listens whether the other one leads."""
PICTURE_S = 10.0
"""A first ego that comes back takes over at the latest after this, whatever it still misses."""


class Lead(Protocol):
    """Whether an ego leads. `look` and `decided` belong to the control cycle."""

    def attach(self, session: Session) -> None:
        """Hears of the other ego from now on."""

    def look(self) -> bool:
        """Whether this ego decides now."""

    def decided(self, has_picture: bool) -> None:
        """It has decided, and knows everybody who is there, or not."""

    def speaks(self) -> bool:
        """Whether others hear what it decides and sees."""


class Alone:
    """An ego without another one."""

    def attach(self, session: Session) -> None:
        """There is nobody to hear of."""

    def look(self) -> bool:
        """It always decides."""
        return True

    def decided(self, has_picture: bool) -> None:
        """It leads anyway."""

    def speaks(self) -> bool:
        """Everybody hears it."""
        return True


class First:
    """An ego that another one stands in for. It decides in every cycle, and is silent only while
    the other leads and this one does not know everybody yet."""

    def __init__(
        self, ego: str, standby: str, log: Logger, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._ego = ego
        self._standby = standby
        self._log = log
        self._monotonic = monotonic
        self._session: Session | None = None
        self._replaced_at: float | None = None
        """Since when the standby leads and this one is silent."""
        self._linked_at: float | None = None
        """Since when the router is reached."""
        self._shown = False

    def attach(self, session: Session) -> None:
        """See `Lead`."""
        session.watch_leading(self._standby, self._on_token)
        self._linked_at = self._monotonic()
        self._session = session

    def look(self) -> bool:
        """It always decides."""
        if self._session is None or self._session.links() == 0:
            self._linked_at = None
        elif self._linked_at is None:
            self._linked_at = self._monotonic()
        return True

    def decided(self, has_picture: bool) -> None:
        """Takes over again, once it has its picture."""
        if not self._has_listened():
            return
        since = self._replaced_at
        if since is not None and (has_picture or self._monotonic() - since >= PICTURE_S):
            self._replaced_at = None
            self._log.info("leads_again", silent_s=round(self._monotonic() - since, 1))
        if self._session is not None and not self._shown and self._replaced_at is None:
            # Where the router went away just now, it is shown in a later cycle.
            with suppress(TransportError):
                self._session.declare_leading(self._ego)
                self._shown = True

    def speaks(self) -> bool:
        """See `Lead`."""
        return self._replaced_at is None and self._has_listened()

    def _has_listened(self) -> bool:
        return self._linked_at is not None and self._monotonic() - self._linked_at >= HEAR_S

    def _on_token(self, there: bool) -> None:
        self._replaced_at = self._monotonic() if there else None


class Standby:
    """An ego that leads while the first one does not."""

    def __init__(
        self,
        ego: str,
        first: str,
        period_s: float,
        log: Logger,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ego = ego
        self._first = first
        self._silent_s = max(SILENT_S, PERIODS * period_s)
        self._log = log
        self._monotonic = monotonic
        self._session: Session | None = None
        self._lock = threading.Lock()
        self._there = False
        """The first one's token is."""
        self._left_at = 0.0
        self._heard_at: float | None = None
        self._linked_at: float | None = None
        """Since when the router is reached."""
        self._patience_s = FIRST_S
        self._leads = False
        self._withdraw: Callable[[], None] | None = None

    def attach(self, session: Session) -> None:
        """See `Lead`."""
        session.watch_leading(self._first, self._on_token)
        key = keyspace.decision(session.swarm, self._first)
        session.subscribe(key, Decision, self._on_decision)
        self._session = session

    def look(self) -> bool:
        """Whether it leads now; shows it."""
        leads = self._is_due(self._monotonic())
        if leads != self._leads:
            self._leads = leads
            self._log.warning("stands_in" if leads else "stands_by", first=self._first)
            self._show(leads)
        return leads

    def decided(self, has_picture: bool) -> None:
        """It leads with what it knows: nobody else does."""

    def speaks(self) -> bool:
        """Also between two looks it is silent as soon as the first one is back."""
        return self._leads and not self._first_decides(self._monotonic())

    def _is_due(self, now: float) -> bool:
        if self._session is None or self._session.links() == 0:
            # Nobody hears it, and it hears nobody: who leads is seen when the router is back.
            self._linked_at = None
            return self._leads
        if self._linked_at is None:
            self._linked_at = now
        if self._first_decides(now):
            self._patience_s = self._silent_s + AGAIN_S
            return False
        with self._lock:
            gone = not self._there and now - self._left_at >= GONE_S
            silent = self._heard_at is None or now - self._heard_at >= self._silent_s
        patient = now - self._linked_at >= self._patience_s
        return self._leads or (patient and (gone or silent))

    def _first_decides(self, now: float) -> bool:
        with self._lock:
            return (
                self._there and self._heard_at is not None and now - self._heard_at < self._silent_s
            )

    def _show(self, leads: bool) -> None:
        if self._withdraw is not None:
            self._withdraw()
            self._withdraw = None
        if leads and self._session is not None:
            # A session that closes just now shows nothing any more.
            with suppress(TransportError):
                self._withdraw = self._session.declare_leading(self._ego)

    def _on_token(self, there: bool) -> None:
        with self._lock:
            self._there = there
            if not there:
                self._left_at = self._monotonic()

    def _on_decision(self, decision: Decision) -> None:
        with self._lock:
            self._heard_at = self._monotonic()
