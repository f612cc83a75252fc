"""Each role, and strangers, against each key and each act: only what `rights` allows passes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from research.benchmarks.rights_matrix import (
    ACTS,
    KEYS,
    ROLES,
    SWARM,
    Site,
    open_site,
    wrong,
)
from swarm import transport, zenoh_config
from swarm.errors import TransportError
from swarm.trust.members import Trust
from swarm.trust.rights import Act
from swarm.trust.roles import LOCAL, Role
from tests.support.free_ports import free_ports
from tests.support.secure_swarm import address, made_keystore


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with open_site(tmp_path_factory.mktemp("trust"), free_ports(3)) as site:
        yield site


@pytest.mark.parametrize("act", ACTS)
@pytest.mark.parametrize("role", [*ROLES, LOCAL], ids=lambda r: r.common_name)
def test_a_role_may_do_its_part_and_nothing_else(site: Site, role: Role, act: Act) -> None:
    assert wrong(site, role, act) == set()


def test_every_key_is_tried() -> None:
    assert len(KEYS) == len(set(KEYS)) == 43


def refused(config: dict[str, object]) -> str:
    with pytest.raises(TransportError) as told:
        transport.open_zenoh(config, timeout_s=2.0)
    return str(told.value)


def test_a_stranger_does_not_come_in(site: Site, tmp_path: Path) -> None:
    foreign = made_keystore(tmp_path / "foreign", SWARM, "R3")
    refused(zenoh_config.client_config(address(foreign, site.port, "R3")))
    refused(zenoh_config.client_config(f"tcp/127.0.0.1:{site.port}"))
    own = {"mode": "client", "scouting/multicast/enabled": False}
    known = str(foreign.identity("R3").ca)
    for extra in ({}, {"transport/link/tls/root_ca_certificate": known}):
        refused(own | {"connect/endpoints": [f"tls/127.0.0.1:{site.port}"]} | extra)


def test_a_robots_certificate_makes_no_router(tmp_path: Path) -> None:
    store = made_keystore(tmp_path / "keystore", SWARM, "R2", "R3")
    port = free_ports(3)
    trust = Trust(store.identity("R3"), {"enabled": False})
    session = transport.open_zenoh(zenoh_config.router_config("127.0.0.1", port, None, trust))
    try:
        for host in ("127.0.0.1", "localhost"):
            own = store.identity("R2").folder
            refused(zenoh_config.client_config(f"tls/{host}:{port}#identity={own}"))
    finally:
        transport.close_zenoh(session)
