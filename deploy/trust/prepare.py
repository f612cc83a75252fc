"""The certificates of a swarm that is to be started."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import Annotated

import msgspec

from deploy.services import KEYSTORE, Place, services
from deploy.spec import SwarmSpec
from deploy.trust.keystore import LIFE, Keystore
from swarm.errors import IdentityError
from swarm.settings import load
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
    names = [member.common_name for member in services(spec, place) if member.common_name]
    revoked = store.revoked() & {*names, operator.common_name}
    if revoked:
        name = min(revoked)
        raise IdentityError(
            f"{name} was revoked in {store.folder}; `coadapt certs issue {name} --again` gives it "
            "its rights back"
        )
    for name in [*names, operator.common_name]:
        own = (place.router_host, "127.0.0.1", "localhost", spec.listen) if name == "router" else ()
        store.issue(name, tuple(dict.fromkeys(filter(None, own))))
