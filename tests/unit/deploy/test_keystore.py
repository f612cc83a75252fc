"""A swarm's authority and what it issues; each way in which a certificate cannot be used."""

from __future__ import annotations

import shutil
import stat
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509

from deploy.trust.keystore import JOINING, LIFE, Keystore
from swarm.errors import IdentityError
from swarm.trust import certificates
from swarm.trust.identity import CERTIFICATE, KEY, Identity
from swarm.trust.members import read_members
from swarm.trust.serving import SERVER_NAME


@pytest.fixture
def store(tmp_path: Path) -> Keystore:
    made = Keystore(tmp_path / "keystore")
    made.init("qa")
    made.issue("router", ("127.0.0.1", "router"))
    made.issue("R3")
    return made


def members(store: Keystore) -> set[str]:
    return {role.common_name for role in read_members(store.identity("router"))}


def test_what_is_issued_holds_for_a_day_at_most_and_is_for_one_role(store: Keystore) -> None:
    held = certificates.check(store.identity("R3"))
    assert certificates.common_name(held) == "R3"
    assert held.not_valid_after_utc - held.not_valid_before_utc == LIFE == timedelta(hours=24)
    assert held.not_valid_before_utc < datetime.now(UTC) < held.not_valid_after_utc
    usage = held.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    # It may serve, too: its metrics, under no name by which a router is reached.
    both = [x509.oid.ExtendedKeyUsageOID.SERVER_AUTH, x509.oid.ExtendedKeyUsageOID.CLIENT_AUTH]
    assert list(usage) == both
    own = held.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [name.value for name in own] == [SERVER_NAME]
    limits = held.extensions.get_extension_for_class(x509.BasicConstraints).value
    assert not limits.ca
    server = certificates.check(store.identity("router"))
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(name.value) for name in names] == ["127.0.0.1", "router", SERVER_NAME]


def test_keys_are_for_their_owner_alone(store: Keystore) -> None:
    keys = list(store.folder.rglob(KEY))
    assert len(keys) == 3
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    folders = [path for path in (store.folder, *store.folder.rglob("*")) if path.is_dir()]
    assert {stat.S_IMODE(path.stat().st_mode) & 0o077 for path in folders} == {0}


def test_a_short_life_begins_before_now_and_ends_after_it(tmp_path: Path) -> None:
    store = Keystore(tmp_path, timedelta(seconds=30))
    store.init("qa")
    held = certificates.check(store.issue("R1"))
    left = held.not_valid_after_utc - datetime.now(UTC)
    assert timedelta(seconds=20) < left < timedelta(seconds=30)


def test_renewing_keeps_key_and_addresses(store: Keystore) -> None:
    identity = store.identity("router")
    key, old = identity.key.read_bytes(), certificates.check(identity)
    version = identity.version()
    store.renew("router")
    new = certificates.check(identity)
    assert identity.key.read_bytes() == key
    assert new.serial_number != old.serial_number
    assert identity.version() != version
    kind = x509.SubjectAlternativeName
    assert new.extensions.get_extension_for_class(kind) == old.extensions.get_extension_for_class(
        kind
    )


def test_issuing_again_makes_a_new_key(store: Keystore) -> None:
    before = store.identity("R3").key.read_bytes()
    store.issue("R3")
    assert store.identity("R3").key.read_bytes() != before


def test_a_third_of_its_life_before_the_end_it_is_renewed(store: Keystore) -> None:
    (issued,) = [one for one in store.issued() if one.name == "R3"]
    assert not store.due(issued, datetime.now(UTC))
    assert store.due(issued, issued.end - LIFE / 3)


def test_an_authority_is_made_once_and_again_only_by_wish(store: Keystore) -> None:
    old = store.identity("R3").ca.read_bytes()
    assert store.init("qa") is False
    certificates.check(store.identity("R3"))
    assert store.init("qa", again=True) is True
    assert store.issued() == []
    assert store.issue("R3").ca.read_bytes() != old


def test_robots_may_join_that_nobody_has_named_yet(store: Keystore) -> None:
    known = members(store)
    assert {f"R{JOINING}", "ego-R3", "console", "gateway"} <= known
    assert "arm-7" not in known
    store.issue("arm-7")
    assert {"arm-7", "ego-arm-7"} <= members(store)


def test_the_revoked_have_no_rights_while_their_certificate_may_be_elsewhere(
    store: Keystore,
) -> None:
    store.revoke("R3")
    assert "R3" not in members(store)
    (issued,) = [one for one in store.issued() if one.name == "R3"]
    assert issued.revoked
    assert not store.due(issued, issued.end)
    with pytest.raises(IdentityError, match=r"R3 was revoked, and its certificate holds until"):
        store.issue("R3")
    assert "R3" not in members(store)
    store.issue("R3", again=True)
    assert "R3" in members(store)


def test_a_revoked_name_is_free_once_its_certificate_is_over(tmp_path: Path) -> None:
    store = Keystore(tmp_path, timedelta(seconds=2))
    store.init("qa")
    store.issue("R3")
    (issued,) = store.issued()
    end = issued.end
    store.revoke("R3")
    while datetime.now(UTC) <= end:
        time.sleep(0.05)
    store.issue("R3")
    assert store.revoked() == set()


def test_only_what_was_issued_can_be_revoked_and_what_a_swarm_needs_cannot(store: Keystore) -> None:
    with pytest.raises(IdentityError, match="was issued to 'R9'; there are R3, router"):
        store.revoke("R9")
    store.issue("console")
    store.revoke("console")
    assert "console" not in members(store)
    store.issue("operator-local")
    for name in ("router", "operator-local"):
        with pytest.raises(IdentityError, match=f"{name} is a part of the swarm that it does not"):
            store.revoke(name)


def test_the_router_keeps_its_addresses_and_is_not_issued_without_one(
    store: Keystore, tmp_path: Path
) -> None:
    held = certificates.check(store.issue("router", ("edge.plant",)))
    names = held.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(name.value) for name in names] == ["127.0.0.1", "router", "edge.plant", SERVER_NAME]
    store.renew("router")
    other = Keystore(tmp_path / "other")
    other.init("qa")
    with pytest.raises(IdentityError, match="issue router --address HOST"):
        other.issue("router")
    with pytest.raises(IdentityError, match="address 'ä' cannot stand in a certificate"):
        other.issue("router", ("ä",))


def test_a_folder_that_is_no_roles_does_no_harm(store: Keystore) -> None:
    shutil.copytree(store.identity("R3").folder, store.folder / "issued" / "R3.bak")
    shutil.copytree(store.identity("R3").folder, store.folder / "issued" / "R4")
    assert [one.name for one in store.issued()] == ["R3", "router"]
    store.revoke("R3")
    assert "R3" not in members(store)


def test_processes_that_change_a_keystore_take_turns(store: Keystore) -> None:
    names = [f"arm-{number}" for number in range(6)]
    for name in names:
        store.issue(name)
    with ThreadPoolExecutor(len(names)) as pool:
        list(pool.map(lambda name: Keystore(store.folder).revoke(name), names))
    assert store.revoked() == set(names)


def break_key(identity: Identity) -> None:
    identity.key.write_text("nothing")


def break_certificate(identity: Identity) -> None:
    identity.certificate.write_text("nothing")


def rename(identity: Identity) -> None:
    other = Keystore(identity.folder.parent.parent).issue("R4")
    shutil.copytree(other.folder, identity.folder, dirs_exist_ok=True)


def foreign(identity: Identity) -> None:
    store = Keystore(identity.folder.parent.parent.parent / "foreign")
    store.init("qa")
    other = store.issue("R3")
    shutil.copy(other.certificate, identity.certificate)
    shutil.copy(other.key, identity.key)


def wrong_key(identity: Identity) -> None:
    other = Keystore(identity.folder.parent.parent).issue("R4")
    shutil.copy(other.key, identity.key)


@pytest.mark.parametrize(
    ("harm", "told"),
    [
        (lambda i: i.certificate.unlink(), "cert.pem, the certificate of R3, cannot be read: No"),
        (lambda i: i.key.unlink(), f"{KEY}, the key of R3, cannot be read: No such file"),
        (lambda i: i.ca.unlink(), "ca.pem, the certificate of the authority, cannot be read"),
        (break_key, f"{KEY}, the key of R3, holds no private key in PEM"),
        (break_certificate, f"{CERTIFICATE} holds no certificate in PEM"),
        (rename, "is of 'R4', and its folder is called 'R3'"),
        (foreign, "of R3 was not issued by the authority in"),
        (wrong_key, "is not the key of the certificate beside it, of R3"),
    ],
)  # fmt: skip
def test_an_identity_that_is_of_no_use_says_which_file_whose_and_what_helps(
    store: Keystore, harm: object, told: str
) -> None:
    assert callable(harm)
    identity = store.identity("R3")
    harm(identity)
    with pytest.raises(IdentityError) as refused:
        certificates.check(identity)
    assert told in str(refused.value)
    assert str(identity.folder) in str(refused.value)
    assert "`coadapt certs i" in str(refused.value)


@pytest.mark.parametrize(
    ("away", "told"),
    [
        (timedelta(days=2), "of R3 ended at .* UTC, and this machine's clock says"),
        (
            timedelta(days=-2),
            "holds from .* UTC on, and this machine's clock .*: set the clock",
        ),
        (timedelta(days=4000), "of the authority ended at .*, and `coadapt certs init --again`"),
    ],
)
def test_a_clock_that_is_off_is_told(store: Keystore, away: timedelta, told: str) -> None:
    with pytest.raises(IdentityError, match=told):
        certificates.check(store.identity("R3"), datetime.now(UTC) + away)


def test_a_lost_authority_is_told(store: Keystore, tmp_path: Path) -> None:
    own = (store.folder / "ca" / KEY).read_bytes()
    shutil.copy(store.identity("R3").key, store.folder / "ca" / KEY)
    with pytest.raises(IdentityError, match=r"ca/key.pem is not the key of the certificate beside"):
        store.issue("R5")
    (store.folder / "ca" / KEY).write_bytes(own)
    store.issue("R5")
    (store.folder / "ca" / KEY).unlink()
    with pytest.raises(IdentityError, match=r"ca/key.pem, the key of the authority, cannot"):
        store.issue("R5")
    with pytest.raises(IdentityError, match=r"ca/key.pem of the authority is lost: .*--again"):
        store.init("qa")
    with pytest.raises(IdentityError, match="has no authority: `coadapt certs init` makes one"):
        Keystore(tmp_path / "empty").issue("R5")


def test_a_keystore_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(IdentityError, match="file/keystore cannot be written"):
        Keystore(tmp_path / "file" / "keystore").init("qa")
