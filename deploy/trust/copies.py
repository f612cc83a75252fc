"""Gives processes on other machines the certificates that were renewed for them."""

from __future__ import annotations

import threading
from pathlib import Path

from deploy.trust.keystore import Keystore
from swarm import keyspace
from swarm.errors import CoAdaptError, IdentityError
from swarm.log import Logger
from swarm.messages import CertificateRequest, RenewedCertificate
from swarm.session import Session


class Copies:
    """Answers at the swarm's router, from when that is there until closed."""

    def __init__(self, store: Keystore, router: str, swarm: str, log: Logger) -> None:
        self._store = store
        self._router = router
        self._swarm = swarm
        self._log = log
        self._stop = threading.Event()
        self._session: Session | None = None
        # Renewing must not wait for a router.
        self._thread = threading.Thread(target=self._serve, name="copies", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Answers nobody any more."""
        self._stop.set()
        self._thread.join()
        if self._session is not None:
            self._session.close()

    def _serve(self) -> None:
        try:
            self._session = Session(self._router, self._swarm, log=self._log, stop=self._stop)
            key = keyspace.trust_certificate(self._swarm)
            self._session.serve(key, CertificateRequest, self._copy)
        except CoAdaptError as error:
            if not self._stop.is_set():
                self._log.error("no_copies", error=str(error)[:300])

    def _copy(self, request: CertificateRequest) -> RenewedCertificate:
        name = request.operator
        if name != request.role:
            raise IdentityError(f"{name} asks for the certificate of {request.role}")
        path: Path = self._store.identity(name).certificate
        if name in self._store.revoked():
            raise IdentityError(f"{name} was revoked")
        try:
            text = path.read_text()
        except OSError as error:
            raise IdentityError(f"no certificate of {name}: {error.strerror}") from error
        self._log.info("copy_given", name=name)
        return RenewedCertificate(request=request.request, certificate=text)
