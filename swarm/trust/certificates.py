"""Reading certificates, and telling why one cannot be used."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID

from swarm.errors import IdentityError
from swarm.trust.identity import Identity

AUTHORITY = "the authority"
AUTHORITY_OF = "CoAdapt Edge swarm "
"""What an authority's common name says before the swarm's."""


def check(
    identity: Identity, now: datetime | None = None, *, fresh: bytes | None = None
) -> x509.Certificate:
    """The certificate of an identity that can be shown now, and that the others will believe;
    with `fresh`, in PEM, that one in place of the one in the file.

    Raises IdentityError that names the file, the role and the remedy: a file is missing or
    cannot be read, the certificate is of another role than its folder, key and certificate do not
    belong together, another authority has signed, or the certificate is over, or its time has not
    come.
    """
    now = now or datetime.now(UTC)
    authority = read_certificate(identity.ca)
    own = read_certificate(identity.certificate, identity.name, fresh)
    name = common_name(own)
    if name != identity.name:
        raise IdentityError(
            f"{identity.certificate} is of {name!r}, and its folder is called {identity.name!r}: "
            f"give the folder the role's name back, or `coadapt certs issue {identity.name}`"
        )
    key = read_key(identity.key, name)
    if key.public_key() != own.public_key():
        raise IdentityError(
            f"{identity.key} is not the key of the certificate beside it, of {name}; {remedy(name)}"
        )
    try:
        own.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise IdentityError(
            f"{identity.certificate} of {name} was not issued by the authority in {identity.ca}: "
            f"one of the two is another swarm's; {remedy(name)}"
        ) from error
    for path, held, whose in (
        (identity.ca, authority, AUTHORITY),
        (identity.certificate, own, name),
    ):
        check_time(path, held, whose, now)
    return own


def check_time(path: Path, held: x509.Certificate, whose: str, now: datetime) -> None:
    """Raises IdentityError for a certificate that does not hold now."""
    begin, end = held.not_valid_before_utc, held.not_valid_after_utc
    if now < begin:
        raise IdentityError(
            f"{path} of {whose} holds from {begin:%F %T} UTC on, and this machine's clock says "
            f"{now:%F %T}: set the clock"
        )
    if now >= end:
        raise IdentityError(
            f"{path} of {whose} ended at {end:%F %T} UTC, and this machine's clock says "
            f"{now:%F %T}; {remedy(whose)}"
        )


def read_certificate(
    path: Path, whose: str = AUTHORITY, text: bytes | None = None
) -> x509.Certificate:
    """A certificate in PEM: the file's, or `text`, which is to take its place. Raises IdentityError
    that names the file and the role."""
    try:
        return x509.load_pem_x509_certificate(
            _read(path, f"the certificate of {whose}", whose) if text is None else text
        )
    except ValueError as error:
        raise IdentityError(
            f"{path} holds no certificate in PEM: {error}; {remedy(whose)}"
        ) from error


def common_name(certificate: x509.Certificate) -> str:
    """Whose certificate it is; empty where it does not say."""
    found = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(found[0].value) if found else ""


def swarm_of_authority(name: str) -> str:
    """The swarm whose authority has this common name; empty for another one's.

    >>> swarm_of_authority("CoAdapt Edge swarm local")
    'local'
    """
    return name.removeprefix(AUTHORITY_OF) if name.startswith(AUTHORITY_OF) else ""


def read_key(path: Path, whose: str) -> ec.EllipticCurvePrivateKey:
    """The private key of a role. Raises IdentityError that names the file and the role."""
    try:
        key = load_pem_private_key(_read(path, f"the key of {whose}", whose), None)
    except (ValueError, TypeError) as error:
        raise IdentityError(
            f"{path}, the key of {whose}, holds no private key in PEM; {remedy(whose)}"
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise IdentityError(
            f"{path}, the key of {whose}, is not of an elliptic curve; {remedy(whose)}"
        )
    return key


def _read(path: Path, what: str, whose: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise IdentityError(
            f"{path}, {what}, cannot be read: {error.strerror}; {remedy(whose)}"
        ) from error


def remedy(whose: str) -> str:
    """What to type where a role's files are of no use."""
    if whose == AUTHORITY:
        return "take the swarm down, and `coadapt certs init --again` makes a new one"
    return f"`coadapt certs issue {whose}` makes a new one"
