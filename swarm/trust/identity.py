"""A process's identity: a folder with its certificate, its key and the authority that it trusts.

What SROS2 calls an enclave. The files are X.509 in PEM, as Zenoh reads them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

CA, CERTIFICATE, KEY = "ca.pem", "cert.pem", "key.pem"
ISSUED = "issued"
"""The folder of a keystore that holds identities."""


@dataclass(frozen=True, slots=True)
class Identity:
    """One role's files. Nothing is read before it is asked for."""

    folder: Path

    @property
    def name(self) -> str:
        """The common name: the folder is called so, and `certificates.check` holds it to that."""
        return self.folder.name

    @property
    def ca(self) -> Path:
        """The certificate of the authority whose certificates this process trusts."""
        return self.folder / CA

    @property
    def certificate(self) -> Path:
        """This process's own certificate."""
        return self.folder / CERTIFICATE

    @property
    def key(self) -> Path:
        """The private key of `certificate`."""
        return self.folder / KEY

    def version(self) -> tuple[int, ...]:
        """Another one as soon as the certificate has been renewed."""
        return stamp(self.certificate)


def stamp(path: Path) -> tuple[int, ...]:
    """By which a file that was written anew is told; empty where there is none."""
    try:
        facts = path.stat()
    except OSError:
        return ()
    return facts.st_mtime_ns, facts.st_ino
