"""Fetches a process's renewed certificate from the swarm's authority.

Where the keystore is on the same machine the authority renews the files themselves, and this has
nothing to do.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import zenoh

from swarm import keyspace
from swarm.asking import Question
from swarm.credit import Window
from swarm.errors import CoAdaptError
from swarm.files import write_whole
from swarm.log import Logger
from swarm.messages import CertificateRequest, RenewedCertificate
from swarm.traffic import TrafficClass
from swarm.trust.identity import Identity

SHARE = 0.25
"""Asked for when so much of a certificate's life is left; the authority renews at a third."""
LOOKS = 24
"""So often in its life it is looked at."""
MAX_PAUSE_S = 60.0
ANSWER_S = 10.0
"""How long the authority is given."""


def last_issued(session: zenoh.Session, swarm: str, name: str) -> str:
    """The certificate, in PEM, that the authority issued last to the role that asks by its common
    name. Raises TransportError where no authority answers, and RefusedError."""
    asked: Question[RenewedCertificate] = Question(
        keyspace.by(keyspace.trust_certificate(swarm), name),
        RenewedCertificate,
        ANSWER_S,
        Window(),
        lambda error: None,  # It comes through the future.
    )
    asked.send(session, CertificateRequest(role=name), TrafficClass.CONTROL)
    return asked.future.result().message.certificate


class Renewal:
    """Looks after one identity on a thread of its own, until closed."""

    def __init__(
        self,
        identity: Identity,
        fetch: Callable[[], str],
        log: Logger,
        *,
        share: float = SHARE,
    ) -> None:
        """`fetch` gives the newest certificate in PEM, and raises CoAdaptError where none comes."""
        self._identity = identity
        self._fetch = fetch
        self._log = log
        self._share = share
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="renewal", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends it, without waiting for an answer under way."""
        self._stop.set()

    def _run(self) -> None:
        pause_s = 0.0
        while not self._stop.wait(pause_s):
            try:
                pause_s = self._look()
            except (CoAdaptError, OSError) as error:
                self._log.warning("certificate_not_renewed", error=str(error)[:300])
                pause_s = min(MAX_PAUSE_S, 2.0 * max(pause_s, 1.0))

    def _look(self) -> float:
        """Fetches what is due; returns after how many seconds to look again."""
        # Only here: the library takes 13 MB, which a plain swarm's processes go without.
        from swarm.trust.certificates import check, read_certificate

        name = self._identity.name
        held = read_certificate(self._identity.certificate, name)
        life = held.not_valid_after_utc - held.not_valid_before_utc
        pause_s = min(MAX_PAUSE_S, life / timedelta(seconds=LOOKS))
        if held.not_valid_after_utc - datetime.now(UTC) > self._share * life:
            return pause_s
        text = self._fetch().encode()
        fresh = check(self._identity, fresh=text)
        # Until the authority has renewed it, its copy is the one that is here.
        if fresh.not_valid_after_utc > held.not_valid_after_utc:
            write_whole(self._identity.certificate, text)
            until = fresh.not_valid_after_utc.isoformat()
            self._log.info("certificate_renewed", name=name, until=until)
        return pause_s
