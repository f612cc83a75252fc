"""Why a router cannot be reached is found out by a connection of one's own, and told in words."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.trust.keystore import Keystore
from swarm.reaching import why_not
from swarm.tcp.info import connections
from swarm.traffic import TrafficClass
from swarm.trust.identity import Identity
from tests.support.free_ports import free_ports
from tests.support.secure_swarm import SecureRouter, made_keystore, secure_router
from tests.support.zenoh_fixtures import RouterProcess


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Keystore:
    return made_keystore(tmp_path_factory.mktemp("own"), "floor", "R2")


@pytest.fixture(scope="module")
def router(store: Keystore) -> Iterator[SecureRouter]:
    with secure_router(store, "floor") as router:
        yield router


def asked(router: RouterProcess, identity: Identity, host: str = "127.0.0.1") -> str:
    return why_not(f"tls/{host}:{router.port}?prio=1-3", identity)


def test_a_router_that_takes_who_asks_is_no_trouble(router: SecureRouter, store: Keystore) -> None:
    assert asked(router, store.identity("R2")) == ""


def test_a_router_of_another_swarm_is_told(router: SecureRouter, tmp_path: Path) -> None:
    foreign = made_keystore(tmp_path, "floor", "R2").identity("R2")
    assert f"is not of the authority in {foreign.ca}" in asked(router, foreign)


def test_a_certificate_that_the_router_does_not_take_is_told(
    router: SecureRouter, store: Keystore, tmp_path: Path
) -> None:
    foreign = made_keystore(tmp_path, "floor", "R2").identity("R2")
    # It believes the router, and the router not it.
    foreign.ca.write_bytes(store.identity("R2").ca.read_bytes())
    assert "the router does not take the certificate of R2" in asked(router, foreign)


def test_a_certificate_for_another_address_is_told(router: SecureRouter, store: Keystore) -> None:
    told = asked(router, store.identity("R2"), "127.0.0.2")
    # It listens on one address only, so the name is what differs here.
    assert told == f"127.0.0.2 is there, but nothing listens on its port {router.port}"
    told = asked(router, store.identity("R2"), "localhost")
    assert told.startswith("the router's certificate is not for localhost: `coadapt certs issue")


def test_a_plain_router_is_told(shared_router: RouterProcess, store: Keystore) -> None:
    assert "127.0.0.1 does not speak TLS there" in asked(shared_router, store.identity("R2"))


def test_a_typo_and_a_port_where_nobody_listens_are_told() -> None:
    assert "'no-such-host.invalid' is the name of no machine" in why_not(
        "tcp/no-such-host.invalid:7447", None
    )
    port = free_ports(1)
    assert why_not(f"tcp/127.0.0.1:{port}", None).endswith(f"nothing listens on its port {port}")
    assert why_not("unixsock-stream//run/x", None) == ""


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_its_own_connection_is_marked_as_control(host: str, store: Keystore) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as server:
        port = server.getsockname()[1]
        locator = f"tls/{f'[{host}]' if ':' in host else host}:{port}"
        asking = threading.Thread(target=why_not, args=(locator, store.identity("R2")))
        asking.start()
        taken, _ = server.accept()  # and says nothing: it waits
        with taken:
            peers = {one.peer for one in connections(TrafficClass.CONTROL)}
        asking.join()
    assert f"{host}:{port}" in peers


def test_who_listens_and_says_nothing_is_no_secure_router(store: Keystore) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        told = why_not(f"tls/127.0.0.1:{port}", store.identity("R2"))
    assert told == "127.0.0.1 does not speak TLS there: a plain swarm's router is tcp/HOST:PORT"
