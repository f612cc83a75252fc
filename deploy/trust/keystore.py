"""A swarm's keystore: its certificate authority and the identities that it issued.

    KEYSTORE/
    ├── ca/            ca.pem, and key.pem: who has that may issue
    ├── issued/NAME/   one role's identity (`swarm.trust.identity`)
    ├── revoked        the common names that the router lets do nothing any more, and until when
    │                  the certificate holds that each had
    └── lock           held by who changes something

What SROS2 calls a keystore, with its enclaves. Keys are of elliptic curve P-256, mode 0600.
"""

from __future__ import annotations

import contextlib
import fcntl
import ipaddress
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from swarm.errors import IdentityError
from swarm.files import write_whole
from swarm.trust import certificates, members
from swarm.trust.identity import CA, CERTIFICATE, ISSUED, KEY, Identity
from swarm.trust.roles import LOCAL, SITE, role_of
from swarm.trust.serving import SERVER_NAME

AUTHORITY, REVOKED, LOCK = "ca", "revoked", "lock"
LIFE = timedelta(hours=24)
AUTHORITY_LIFE = timedelta(days=3650)
EARLY = timedelta(minutes=5)
"""Clocks of a swarm may be apart by so much: certificates hold from that long ago on (those that
live less than ten times as long, from a tenth of it)."""
NEEDED = ("router", "controller", LOCAL.common_name)
"""What cannot be revoked: a swarm does not run without it, or needs no certificate."""
JOINING = 100
"""R1 to R100 may join a swarm while it runs: Zenoh reads its rules only when a router opens, which
costs everybody's links a moment, and so these have theirs from the start."""


@dataclass(frozen=True, slots=True)
class Issued:
    """One identity of a keystore."""

    name: str
    serial: int
    end: datetime
    revoked: bool


class Keystore:
    """The keystore in a folder. Raises IdentityError for what cannot be read or written."""

    def __init__(self, folder: Path, life: timedelta = LIFE) -> None:
        """`life`: how long certificates hold that are issued from now on."""
        self.folder = folder
        self._life = life

    def init(self, swarm: str, *, again: bool = False) -> bool:
        """Makes the authority; False where there is one. `again` makes a new one in its place, and
        removes what the old one issued: to be done while the swarm does not run."""
        with self._alone():
            ca = self.folder / AUTHORITY
            if (ca / KEY).exists() and (ca / CA).exists() and not again:
                return False
            if not again and ((ca / KEY).exists() or (ca / CA).exists()):
                lost = KEY if (ca / CA).exists() else CA
                raise IdentityError(
                    f"{ca / lost} of the authority is lost: "
                    f"{certificates.remedy(certificates.AUTHORITY)}"
                )
            key = ec.generate_private_key(ec.SECP256R1())
            title = f"{certificates.AUTHORITY_OF}{swarm}"
            name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, title)])
            made = (
                _begun(name, name, key, AUTHORITY_LIFE)
                .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
                .add_extension(_usage(signs=True), critical=True)
                .sign(key, hashes.SHA256())
            )
            shutil.rmtree(self.folder / ISSUED, ignore_errors=True)
            (self.folder / REVOKED).unlink(missing_ok=True)
            _put(ca, {CA: _pem(made), KEY: _key_pem(key)})
        return True

    def issue(self, name: str, addresses: Sequence[str] = (), *, again: bool = False) -> Identity:
        """A new key and certificate for a role, in place of an older one.

        `addresses`: the host names and IP addresses under which others reach it, beside those of
        the older one. `again`: also for a name that was revoked, while the certificate that was
        taken from it still holds.
        """
        role = role_of(name)
        with self._alone():
            revoked = self._revoked()
            until = revoked.pop(name, None)
            if until is not None and until > datetime.now(UTC) and not again:
                raise IdentityError(
                    f"{name} was revoked, and its certificate holds until {until:%F %T} UTC: who "
                    "has that would have its rights back; use another name, or `coadapt certs "
                    f"issue {name} --again` where nobody has it"
                )
            known = dict.fromkeys([*self.addresses(name), *addresses])
            if role.kind == "router" and not known:
                raise IdentityError(
                    f"the certificate of {name} needs the addresses under which others reach it: "
                    f"`coadapt certs issue {name} --address HOST`"
                )
            self._issue(name, ec.generate_private_key(ec.SECP256R1()), list(known))
            self._write_revoked(revoked)
        return self.identity(name)

    def renew(self, name: str) -> datetime:
        """A new certificate for the key that a role has, and for the same addresses: whoever reads
        the two files while this is done finds a pair. Returns when it ends."""
        with self._alone():
            key = certificates.read_key(self.identity(name).key, name)
            return self._issue(name, key, self.addresses(name)).not_valid_after_utc

    def _issue(
        self, name: str, key: ec.EllipticCurvePrivateKey, addresses: Sequence[str]
    ) -> x509.Certificate:
        role = role_of(name)
        ca, ca_key = self._authority()
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, role.common_name)])
        # A router is reached by others and reaches those of other machines itself; every other
        # process may serve its metrics.
        usage = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = (
            _begun(subject, ca.subject, key, self._life)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        )
        names = [_general(address) for address in (*addresses, SERVER_NAME)]
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        made = builder.sign(ca_key, hashes.SHA256())
        _put(
            self.identity(name).folder,
            {CA: _pem(ca), KEY: _key_pem(key), CERTIFICATE: _pem(made)},
        )
        return made

    def identity(self, name: str) -> Identity:
        """Where the identity of a role lies, whether it has been issued or not."""
        return Identity(self.folder / ISSUED / role_of(name).common_name)

    def revoke(self, name: str) -> None:
        """Takes a role's rights away: in the network, for the router reads the list, and nothing is
        issued to it as long as its certificate holds."""
        with self._alone():
            issued = {one.name: one for one in self.issued()}
            if name not in issued and not (self.folder / ISSUED / name).exists():
                raise IdentityError(
                    f"no certificate was issued to {name!r}; there are "
                    f"{', '.join(issued) or 'none'}"
                )
            if name in NEEDED:
                raise IdentityError(
                    f"{name} is a part of the swarm that it does not run without: take the swarm "
                    "down, and `coadapt certs init --again` makes a new authority"
                )
            end = issued[name].end if name in issued else datetime.now(UTC) + self._life
            self._write_revoked(self._revoked() | {name: end})

    def revoked(self) -> set[str]:
        """The common names that have been revoked."""
        return set(self._revoked())

    def issued(self) -> list[Issued]:
        """What has been issued, by name; what cannot be read, or is of no role, is left out."""
        revoked = self.revoked()
        found = []
        for name in self.names():
            with contextlib.suppress(IdentityError):
                held = certificates.read_certificate(self.identity(name).certificate, name)
                if certificates.common_name(held) == name:
                    end = held.not_valid_after_utc
                    found.append(Issued(name, held.serial_number, end, name in revoked))
        return found

    def names(self) -> list[str]:
        """The roles that have a folder, sorted, whether its files can be read or not."""
        found = []
        for path in sorted((self.folder / ISSUED).glob("*")):
            with contextlib.suppress(IdentityError):
                found.append(role_of(path.name).common_name)
        return found

    def due(self, issued: Issued, now: datetime) -> bool:
        """Whether it is time to renew: a third of its life is left, or less."""
        return not issued.revoked and issued.end - now <= self._life / 3

    def _authority(self) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
        folder = self.folder / AUTHORITY
        if not folder.exists():
            raise IdentityError(
                f"keystore {self.folder} has no authority: `coadapt certs init` makes one"
            )
        identity = Identity(folder)
        ca = certificates.read_certificate(identity.ca)
        certificates.check_time(identity.ca, ca, certificates.AUTHORITY, datetime.now(UTC))
        key = certificates.read_key(identity.key, certificates.AUTHORITY)
        if key.public_key() != ca.public_key():
            raise IdentityError(
                f"{identity.key} is not the key of the certificate beside it, of the authority; "
                f"{certificates.remedy(certificates.AUTHORITY)}"
            )
        return ca, key

    def addresses(self, name: str) -> list[str]:
        """Those in the certificate that a role has; none where it has none that can be read."""
        try:
            held = certificates.read_certificate(self.identity(name).certificate, name)
            found = held.extensions.get_extension_for_class(x509.SubjectAlternativeName)
        except (IdentityError, x509.ExtensionNotFound):
            return []
        return [str(one.value) for one in found.value if one.value != SERVER_NAME]

    def _revoked(self) -> dict[str, datetime]:
        """The revoked, and when the certificate ends that each had."""
        path = self.folder / REVOKED
        try:
            lines = [line.split() for line in path.read_text().splitlines()]
            return {name: datetime.fromisoformat(end) for name, end in lines}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            raise IdentityError(
                f"{path}, the list of the revoked, cannot be read: {error}"
            ) from error

    def _write_revoked(self, revoked: Mapping[str, datetime]) -> None:
        # First the router: who is said to be revoked has no rights.
        self._write_members(set(revoked))
        lines = [f"{name} {end.isoformat()}\n" for name, end in sorted(revoked.items())]
        write_whole(self.folder / REVOKED, "".join(lines))

    def _write_members(self, revoked: set[str]) -> None:
        """Tells the routers who has rights, where that is not what they were told before."""
        routers = [name for name in self.names() if role_of(name).kind == "router"]
        robots = [f"R{number}" for number in range(1, JOINING + 1)]
        names = {*SITE, *robots, *self.names()}
        # Any robot may be the host of an ego.
        names |= {f"ego-{name}" for name in names if role_of(name).kind == "robot"}
        for router in routers:
            members.write_members(self.identity(router), names - revoked)

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Keeps other processes that change this keystore waiting."""
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            os.chmod(self.folder, 0o700)
            with open(self.folder / LOCK, "a") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                yield
        except OSError as error:
            raise IdentityError(f"keystore {self.folder} cannot be written: {error}") from error


def _begun(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, life: timedelta
) -> x509.CertificateBuilder:
    begin = datetime.now(UTC) - min(EARLY, life / 10)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(begin + life)
    )


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _general(address: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(address))
    except ValueError:
        pass
    try:
        return x509.DNSName(address)
    except ValueError as error:
        raise IdentityError(
            f"address {address!r} cannot stand in a certificate: {error}"
        ) from error


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _put(folder: Path, files: dict[str, bytes]) -> None:
    for place in (folder.parent, folder):
        place.mkdir(mode=0o700, exist_ok=True)
    for name, text in files.items():
        write_whole(folder / name, text, mode=0o600 if name == KEY else 0o644)
