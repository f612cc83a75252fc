"""A Zenoh session that keeps all its links: one for each traffic class.

A session whose certificate has been renewed is replaced in the same way.

After a router restart a client of Zenoh 1.10 comes back with one link of the three
(eclipse-zenoh/zenoh#2130), over which all traffic classes would then travel together. A watchdog
notices, opens a second session, declares everything there, and only then closes the first one, so
that liveliness tokens never vanish in between.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

import zenoh

from swarm import transport, zenoh_config
from swarm.errors import IdentityError, TransportError
from swarm.log import Logger
from swarm.tcp.dead import GiveUp
from swarm.transport import CLOSE_S, Entity, close_zenoh

POLL_S = 0.5
GRACE_S = 1.5
"""How long links may be missing before a new session is tried; links come one after the other."""
MAX_GRACE_S = 60.0
"""Where a new session has no more links either (a port is closed), it is tried this rarely."""
OPEN_S = 5.0
SETTLE_S = 1.0
"""How long the links of a new session may take to come up one after the other."""
LINGER_S = 1.0
"""How long a session that was replaced stays: others must hear of the new one first, and answers
to requests under way may still come over it."""

Declaration = Callable[[zenoh.Session], Entity]


class Connection:
    """The current Zenoh session and everything declared on it."""

    def __init__(
        self,
        router: str,
        *,
        log: Logger,
        timeout_s: float | None = None,
        stop: threading.Event | None = None,
    ) -> None:
        """Connects to the router, trying again until it is there.

        Raises SettingError for a malformed router, IdentityError for a certificate that cannot be
        shown, and TransportError when `timeout_s` has passed or `stop` was set first.
        """
        self._config = zenoh_config.client_config(router)
        self.identity = zenoh_config.shown_identity(self._config)
        """Whose certificate its sessions show; None where they show none."""
        self._shown = self.identity.version() if self.identity else ()
        self._expected = zenoh_config.expected_links(self._config)
        self._log = log
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._declarations: list[Declaration] = []
        self._entities: list[Entity] = []
        self.reopened = 0
        """How often a session was replaced, for its links or its certificate."""
        place = router.partition("#")[0]
        self._zenoh = transport.open_zenoh(
            self._config,
            timeout_s=timeout_s,
            stop=stop,
            on_wait=lambda why: log.warning("router_away", router=place, why=why),
        )
        self._watcher = threading.Thread(target=self._watch, name="links", daemon=True)
        self._watcher.start()

    @property
    def zenoh(self) -> zenoh.Session:
        """The session to use now; do not keep it."""
        return self._zenoh

    def declare(self, make: Declaration) -> Callable[[], None]:
        """Declares an entity now, and again on every session that replaces this one.

        Returns what withdraws it. Raises TransportError when the connection is closed.
        """
        with self._lock:
            try:
                self._entities.append(make(self._zenoh))
            except zenoh.ZError as error:
                raise TransportError(f"cannot declare: {error}") from error
            self._declarations.append(make)
        return lambda: self._withdraw(make)

    def _withdraw(self, make: Declaration) -> None:
        """Does nothing the second time, and once the connection is closed."""
        with self._lock:
            if make not in self._declarations or self._closing.is_set():
                return
            at = self._declarations.index(make)
            del self._declarations[at]
            entity = self._entities.pop(at)
            # With the link gone the others have noticed already.
            with suppress(zenoh.ZError):
                entity.undeclare()

    def links(self) -> int:
        """Number of transport links to the router that are up; 0 once closed."""
        return _links(self._zenoh)

    def close(self) -> None:
        """Withdraws everything and closes; never waits longer than a few seconds."""
        self._closing.set()
        # The watchdog may be replacing the session just now, and holds the lock while it does.
        held = self._lock.acquire(timeout=CLOSE_S)
        try:
            entities, self._entities = self._entities, []
            close_zenoh(self._zenoh, entities)
        finally:
            if held:
                self._lock.release()
        # Python aborts where it ends while Zenoh works on another of its threads.
        if self._watcher is not threading.current_thread():
            self._watcher.join(CLOSE_S)

    def _watch(self) -> None:
        grace_s = GRACE_S
        short_since: float | None = None
        renew_at, renew_s = 0.0, POLL_S
        give_up = GiveUp()
        while not self._closing.wait(POLL_S):
            # Without a descriptor to spare nobody can look.
            with suppress(OSError):
                give_up.look()
            up = self.links()
            if up and self._renewed() and time.monotonic() >= renew_at:
                done = self._replace(up, "identity_renewed")
                renew_s = POLL_S if done else min(2 * renew_s, MAX_GRACE_S)
                renew_at = time.monotonic() + renew_s
                continue
            # Without any link Zenoh itself goes on trying until the router is back.
            if up == 0 or up >= self._expected:
                short_since = None
                grace_s = GRACE_S if up else grace_s
                continue
            now = time.monotonic()
            short_since = now if short_since is None else short_since
            if now - short_since < grace_s:
                continue
            grace_s = (
                GRACE_S
                if self._replace(up + 1, "links_restored")
                else min(2 * grace_s, MAX_GRACE_S)
            )
            short_since = None

    def _renewed(self) -> bool:
        """Whether the certificate that the session shows has been replaced by a newer one."""
        return self.identity is not None and self.identity.version() not in (self._shown, ())

    def _replace(self, least: int, what: str) -> bool:
        """Moves everything to a new session; False when that would have less links than `least`.
        `what` is logged where it is done."""
        up, shown = self.links(), self.identity.version() if self.identity else ()
        try:
            fresh = transport.open_zenoh(self._config, timeout_s=OPEN_S, stop=self._closing)
        except (TransportError, IdentityError) as error:
            self._log.warning("not_replaced", links=up, error=str(error)[:300])
            return False
        settled = time.monotonic() + SETTLE_S
        while (found := _links(fresh)) < self._expected and time.monotonic() < settled:
            self._closing.wait(POLL_S / 10)
        if found < least:
            self._log.warning("links_missing", links=up, expected=self._expected)
            close_zenoh(fresh)
            return False
        with self._lock:
            if self._closing.is_set():
                close_zenoh(fresh)
                return False
            try:
                entities = [make(fresh) for make in self._declarations]
            except zenoh.ZError as error:
                self._log.warning("not_replaced", links=up, error=str(error)[:300])
                close_zenoh(fresh)
                return False
            old, self._zenoh = self._zenoh, fresh
            self._shown = shown
            withdrawn, self._entities = self._entities, entities
            self.reopened += 1
        self._log.info(what, before=up, links=found)
        self._closing.wait(LINGER_S)
        close_zenoh(old, withdrawn)
        return True


def _links(session: zenoh.Session) -> int:
    try:
        return len(list(session.info.links()))
    except zenoh.ZError:
        return 0
