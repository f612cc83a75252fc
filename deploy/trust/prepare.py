"""The certificates of a swarm that is to be started."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import msgspec

from deploy.paths import KEYSTORE
from deploy.ports import LOCALHOST
from deploy.roster import Place
from deploy.services import services
from deploy.spec import SwarmSpec
from deploy.trust.keystore import AUTHORITY, LIFE, Keystore
from swarm.errors import IdentityError
from swarm.settings import load
from swarm.trust.certificates import read_certificate
from swarm.trust.identity import CA
from swarm.trust.roles import Role

SHORTEST_S = 30


class LifeSettings(msgspec.Struct, frozen=True, kw_only=True):
    """How long certificates hold."""

    certificate_life_s: Annotated[
        int, msgspec.Meta(ge=SHORTEST_S, le=int(LIFE.total_seconds()), description="seconds")
    ] = int(LIFE.total_seconds())


def keystore_of(var_dir: str) -> Keystore:
    """The keystore of the swarm with this directory. Raises SettingError."""
    life = timedelta(seconds=load(LifeSettings).certificate_life_s)
    return Keystore(Path(var_dir, KEYSTORE), life)


def prepare(spec: SwarmSpec, place: Place, operator: Role) -> None:
    """Issues new certificates to all processes of a swarm, and to the operator who starts it;
    makes the authority where there is none.

    Raises IdentityError, also for a robot that was revoked.
    """
    store = keystore_of(spec.var_dir)
    store.init(spec.swarm)
    members = [member.common_name for member in services(spec, place) if member.common_name]
    for name in _allowed([*members, operator.common_name], store):
        store.issue(name, _addresses(name, place, spec.listen))


def keep(
    spec: SwarmSpec,
    place: Place,
    names: Iterable[str],
    addresses: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> tuple[str, ...]:
    """Issues certificates to those of these roles that have none, or whose it is time to renew: for
    processes on other machines, which start anew with what is new. Returns whose.

    `addresses`: at which others reach a role that is not the site's router.

    Raises IdentityError, also for a robot that was revoked.
    """
    store = keystore_of(spec.var_dir)
    store.init(spec.swarm)
    now = datetime.now(UTC)
    issued = {one.name: one for one in store.issued() if one.end > now}
    new = []
    for name in _allowed(names, store):
        own = addresses.get(name) or _addresses(name, place, spec.listen)
        if name not in issued or set(own) - set(store.addresses(name)):
            store.issue(name, own)
        elif store.due(issued[name], now):
            store.renew(name)
        else:
            continue
        new.append(name)
    return tuple(new)


def begun(var_dir: str, swarm: str) -> int:
    """When the authority of a swarm with this directory began, nanoseconds since the Unix epoch: a
    time that is the same whenever a description of the swarm is written. Makes the authority where
    there is none. Raises IdentityError."""
    store = keystore_of(var_dir)
    store.init(swarm)
    begin = read_certificate(store.folder / AUTHORITY / CA).not_valid_before_utc
    return int(begin.timestamp()) * 1_000_000_000


def _allowed(names: Iterable[str], store: Keystore) -> list[str]:
    """The names. Raises IdentityError for one that was revoked."""
    wanted = list(names)
    revoked = store.revoked() & set(wanted)
    if revoked:
        name = min(revoked)
        raise IdentityError(
            f"{name} was revoked in {store.folder}; `coadapt certs issue {name} --again` gives it "
            "its rights back"
        )
    return wanted


def _addresses(name: str, place: Place, listen: str) -> tuple[str, ...]:
    """Those that a new certificate gets."""
    own = (place.router_host, LOCALHOST, "localhost", listen) if name == "router" else ()
    return tuple(dict.fromkeys(filter(None, own)))
