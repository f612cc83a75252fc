"""A router that lets in only who has a certificate, and certificates for who asks there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

from deploy.trust.keystore import LIFE, Keystore
from tests.support.zenoh_fixtures import RouterProcess

HOST = "127.0.0.1"


def made_keystore(folder: Path, swarm: str, *names: str, life: timedelta = LIFE) -> Keystore:
    """A new keystore with identities of these roles and of the router."""
    store = Keystore(folder, life)
    store.init(swarm)
    store.issue("router", (HOST,))
    for name in names:
        store.issue(name)
    return store


def address(store: Keystore, port: int, name: str) -> str:
    """The router's address for a role."""
    return f"tls/{HOST}:{port}#identity={store.identity(name).folder}"


class SecureRouter(RouterProcess):
    """`python -m swarm.router --identity ...` with the keystore's certificates."""

    def __init__(self, store: Keystore, swarm: str, *options: str) -> None:
        self.store = store
        identity = str(store.identity("router").folder)
        super().__init__("--swarm", swarm, "--identity", identity, *options)

    def of(self, name: str) -> str:
        """This router's address for a role."""
        return address(self.store, self.port, name)


@contextmanager
def secure_router(store: Keystore, swarm: str, *options: str) -> Iterator[SecureRouter]:
    """A `SecureRouter` for the block."""
    router = SecureRouter(store, swarm, *options)
    try:
        yield router
    finally:
        router.stop()
