"""Each role of a secure swarm against each key and each act: what the router lets pass.

The router runs in this process and may do all, so that it sees what comes through and answers
what is asked; each role comes as a stranger's client would, with its certificate and nothing of
ours in between.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import zenoh

from deploy.trust.keystore import Keystore
from swarm import keyspace, transport, zenoh_config
from swarm.areas import name_of
from swarm.trust import members
from swarm.trust.rights import Act, rights_of
from swarm.trust.roles import LOCAL, SITE, Role, role_of

SWARM = "rights"
ROLES = [
    # A router's certificate is for a server: no client comes with it.
    *(role_of(name) for name in SITE if name != "router"),
    Role("robot", "R2"),
    Role("robot", "R3"),
    Role("ego", "R1"),
    Role("controller", "hall-2"),
    Role("operator", "ann"),
    Role("reader", "bob"),
]
ROBOT_KEYS = (
    keyspace.alive, keyspace.beacon, keyspace.scene, keyspace.observation, keyspace.robot_steering,
)  # fmt: skip
EGO_KEYS = (
    keyspace.decision, keyspace.detections, keyspace.ego_steering, keyspace.ego_leads,
)  # fmt: skip
SITE_KEYS = (
    keyspace.net_state, keyspace.net_tcp, keyspace.net_demand, keyspace.net_shape,
    keyspace.llm_decide, keyspace.llm_wish, keyspace.llm_state, keyspace.llm_alive,
    keyspace.trust_certificate,
)  # fmt: skip
CELL = name_of((3, -4))
SHARED = "early"
KEYS = [
    *(keyspace.shared(SWARM, robot, SHARED) for robot in ("R1", "R2", "R3")),
    *(key(SWARM, robot) for key in ROBOT_KEYS for robot in ("R1", "R2", "R3")),
    *(key(SWARM, ego) for key in EGO_KEYS for ego in ("R1", "R2")),
    *(key(SWARM) for key in SITE_KEYS),
    *(
        keyspace.metrics(SWARM, role, "http:10.0.0.7:9101")
        for role in ("R3", "ego-R1", "controller", "controller-hall-2")
    ),
    *(key(SWARM, "hall-2") for key in (keyspace.net_state, keyspace.net_shape)),
    *(keyspace.within(key(SWARM, "R3"), CELL) for key in (keyspace.beacon, keyspace.scene)),
]
WILD = [
    f"coadapt/{SWARM}/**",
    f"coadapt/{SWARM}/robot/*/beacon",
    f"coadapt/{SWARM}/robot/*/beacon/{CELL}",
    f"coadapt/{SWARM}/robot/*/beacon/**",
    "**",
]
QUIET_S = 0.4
"""How long what is denied is given to come through; what is allowed is waited for longer."""
WAIT_S = 20.0


class Site(NamedTuple):
    """A router that sees all, and how a role comes to it."""

    session: zenoh.Session
    port: int
    open: Callable[[Role], zenoh.Session]


@contextmanager
def open_site(folder: Path, port: int) -> Iterator[Site]:
    """A secure router on three loopback ports from `port` on, with a keystore in `folder`."""
    store = Keystore(folder / "keystore")
    store.init(SWARM)
    store.issue("router", ("127.0.0.1",))
    for role in ROLES:
        store.issue(role.common_name)
    socket = f"{folder}/r.sock"
    trust = members.trust_of(store.identity("router"), SWARM)
    session = transport.open_zenoh(zenoh_config.router_config("127.0.0.1", port, socket, trust))

    def connect(role: Role) -> zenoh.Session:
        identity = store.identity(role.common_name).folder
        router = f"tls/127.0.0.1:{port}#identity={identity}"
        if role == LOCAL:
            router = f"unixsock-stream/{socket}"
        return transport.open_zenoh(zenoh_config.client_config(router), timeout_s=WAIT_S)

    try:
        yield Site(session, port, connect)
    finally:
        transport.close_zenoh(session)


@contextmanager
def joined(site: Site, role: Role) -> Iterator[zenoh.Session]:
    """A role's own session, for the block."""
    session = site.open(role)
    try:
        yield session
    finally:
        transport.close_zenoh(session)


def allowed(role: Role, act: Act, key: str) -> bool:
    """Whether the table of rights allows it."""
    return any(
        right.act == act and zenoh.KeyExpr(right.key).includes(zenoh.KeyExpr(key))
        for right in rights_of(role, SWARM)
    )


def wanted(role: Role, act: Act) -> set[str]:
    """The keys on which a role may do something."""
    return {key for key in KEYS if allowed(role, act, key)}


def _settle(found: set[str], expected: set[str]) -> set[str]:
    """What was found once all that is expected is there, and a moment later."""
    _wait(lambda: found >= expected)
    time.sleep(QUIET_S)
    return set(found)


def puts(site: Site, session: zenoh.Session, role: Role) -> set[str]:
    """The keys on which its words pass."""
    found: set[str] = set()
    subscriber = site.session.declare_subscriber(
        "coadapt/**", lambda sample: found.add(str(sample.key_expr))
    )
    for key in [*KEYS, *WILD]:
        session.put(key, b"word", congestion_control=zenoh.CongestionControl.BLOCK)
    result = _settle(found, wanted(role, "put"))
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return result


def listens(site: Site, session: zenoh.Session, role: Role) -> set[str]:
    """The keys on which it hears others."""
    found: set[str] = set()
    subscribers = [
        session.declare_subscriber(key, lambda sample: found.add(str(sample.key_expr)))
        for key in [*KEYS, *WILD]
    ]

    def tell() -> bool:
        for key in KEYS:
            site.session.put(key, b"word", congestion_control=zenoh.CongestionControl.BLOCK)
        return found >= wanted(role, "listen")

    _wait(tell)
    result = _settle(found, set())
    for subscriber in subscribers:
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    return result


def serves(site: Site, session: zenoh.Session, role: Role) -> set[str]:
    """The keys on which it is asked, and its answers pass."""

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"mine")

    queryables = [
        session.declare_queryable(keyspace.by(key, "*"), answer, complete=True) for key in KEYS
    ]
    queryables += [session.declare_queryable(key, answer, complete=True) for key in [*KEYS, *WILD]]
    found: set[str] = set()

    def ask(keys: list[str]) -> bool:
        for key in keys:
            for asked in (key, keyspace.by(key, "somebody")):
                replies = site.session.get(asked, timeout=QUIET_S)
                if any(reply.ok is not None for reply in replies):
                    found.add(key)
        return found >= wanted(role, "serve")

    _wait(lambda: ask(sorted(wanted(role, "serve") - found)))
    ask(KEYS)
    for queryable in queryables:
        queryable.undeclare()  # type: ignore[no-untyped-call]
    return found


def asks(site: Site, session: zenoh.Session, role: Role) -> set[str]:
    """The keys on which its questions pass; a whole key where they pass by another's name."""
    found: set[str] = set()

    def answer(query: zenoh.Query) -> None:
        found.add(str(query.key_expr))
        with query:
            query.reply(query.key_expr, b"yours")

    queryable = site.session.declare_queryable("coadapt/**", answer)
    answered: set[str] = set()

    def ask(keys: set[str], name: str) -> None:
        for key in keys:
            replies = session.get(keyspace.by(key, name), timeout=QUIET_S)
            if any(reply.ok is not None for reply in replies):
                answered.add(key)

    own = wanted(role, "ask")

    def ask_own() -> bool:
        ask(own - answered, role.common_name)
        return answered >= own

    _wait(ask_own)
    for selector in [*KEYS, *WILD]:
        # Not waited for: all that counts is what arrives.
        session.get(selector, zenoh.handlers.RingChannel(1), timeout=QUIET_S)
        session.get(
            keyspace.by(selector, "console2"), zenoh.handlers.RingChannel(1), timeout=QUIET_S
        )
        name = role.common_name
        session.get(keyspace.by(selector, name), zenoh.handlers.RingChannel(1), timeout=QUIET_S)
    time.sleep(2 * QUIET_S)
    queryable.undeclare()  # type: ignore[no-untyped-call]
    # What came by another name is wrong, whatever the key.
    return {
        key.rpartition("/by/")[0] if keyspace.asker_of(key) == role.common_name else key
        for key in found
    }


def holds(site: Site, session: zenoh.Session, role: Role) -> set[str]:
    """The keys on which its tokens are seen."""
    tokens = [session.liveliness().declare_token(key) for key in KEYS]
    found: set[str] = set()

    def look() -> bool:
        for reply in site.session.liveliness().get("coadapt/**", timeout=WAIT_S):
            if reply.ok is not None:
                found.add(str(reply.ok.key_expr))
        return found >= wanted(role, "hold")

    _wait(look)
    time.sleep(QUIET_S)
    look()
    for token in tokens:
        token.undeclare()  # type: ignore[no-untyped-call]
    return found


def watches(site: Site, session: zenoh.Session, role: Role) -> set[str]:
    """The keys on which it sees tokens."""
    tokens = [site.session.liveliness().declare_token(key) for key in KEYS]
    found: set[str] = set()
    subscribers = [
        session.liveliness().declare_subscriber(
            key, lambda sample: found.add(str(sample.key_expr)), history=True
        )
        for key in [*KEYS, keyspace.alive(SWARM, "*"), keyspace.ego_leads(SWARM, "*"), *WILD]
    ]

    def look() -> bool:
        for key in (
            keyspace.alive(SWARM, "*"),
            keyspace.ego_leads(SWARM, "*"),
            keyspace.llm_alive(SWARM),
        ):
            for reply in session.liveliness().get(key, timeout=QUIET_S):
                if reply.ok is not None:
                    found.add(str(reply.ok.key_expr))
        return found >= wanted(role, "watch")

    _wait(look)
    result = _settle(found, set())
    for subscriber in subscribers:
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    for token in tokens:
        token.undeclare()  # type: ignore[no-untyped-call]
    return result


ACTS: dict[Act, Callable[[Site, zenoh.Session, Role], set[str]]] = {
    "put": puts, "listen": listens, "serve": serves, "ask": asks, "hold": holds, "watch": watches,
}  # fmt: skip


def wrong(site: Site, role: Role, act: Act) -> set[str]:
    """The keys on which a role may do what it should not, or not what it should."""
    with joined(site, role) as session:
        return ACTS[act](site, session, role) ^ wanted(role, act)


def _wait(condition: Callable[[], bool]) -> None:
    """Until it holds, but not for ever: what is missing then is wrong."""
    deadline = time.monotonic() + WAIT_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
