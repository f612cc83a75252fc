"""Two routers that are linked: everything of the swarm passes, and each holds its own to their
rights."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import msgspec
import pytest

from deploy.trust.keystore import Keystore
from swarm import keyspace
from swarm.messages import (
    Beacon,
    CertificateRequest,
    EgoSteered,
    EgoSteering,
    EgoWish,
    RenewedCertificate,
    RobotSteered,
    RobotSteering,
)
from swarm.session import Session
from swarm.traffic import TrafficClass
from swarm.trust.identity import Identity
from tests.support.free_ports import free_port
from tests.support.message_samples import SAMPLES
from tests.support.secure_swarm import HOST, made_keystore
from tests.support.zenoh_fixtures import WAIT_S, Inbox, RouterProcess, until

SWARM = "mesh"
NAMES = ("R2", "R3", "ego-R1", "operator-ann", "reader-bob", "authority")
BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))
STEERED = next(sample for sample in SAMPLES if isinstance(sample, RobotSteered))
QUIET_S = 1.0
"""How long what is denied is given to come through."""


class Machine(RouterProcess):
    """A router with a certificate, and what its log says."""

    def __init__(
        self,
        store: Keystore,
        name: str,
        log: Path,
        *peers: Machine,
        identity: Identity | None = None,
        options: tuple[str, ...] = (),
    ) -> None:
        """`identity`: a copy of the keystore's, as it is on another machine."""
        self.store = store
        self.log = log
        folder = str((identity or store.identity(name)).folder)
        words = [word for peer in peers for word in ("--peer", f"tls/{HOST}:{peer.port}")]
        super().__init__("--swarm", SWARM, "--identity", folder, *words, *options)
        # Whoever does not read a pipe stops who writes to it.
        threading.Thread(target=self._keep, daemon=True).start()

    def of(self, name: str) -> Session:
        router = f"tls/{HOST}:{self.port}#identity={self.store.identity(name).folder}"
        return Session(router, SWARM, timeout_s=WAIT_S)

    def reasons(self, event: str) -> list[str]:
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        entries = [json.loads(line) for line in lines if line.startswith("{")]
        return [entry.get("why", "") for entry in entries if entry["event"] == event]

    def _keep(self) -> None:
        process = self._process
        assert process is not None
        assert process.stderr is not None
        with open(self.log, "a", buffering=1) as log:
            for line in process.stderr:
                log.write(line)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Keystore:
    store = made_keystore(tmp_path_factory.mktemp("keys"), SWARM, *NAMES)
    store.issue("router-B", (HOST,))
    return store


@pytest.fixture(scope="module")
def machines(
    store: Keystore, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Machine, Machine]]:
    """A's router, and B's, which names it."""
    logs = tmp_path_factory.mktemp("logs")
    with ExitStack() as stack:
        first = Machine(store, "router", logs / "A", options=("--targets", f"{logs}/joined.json"))
        stack.callback(first.stop)
        metrics = ("--metrics-port", str(free_port()))
        second = Machine(store, "router-B", logs / "B", first, options=metrics)
        stack.callback(second.stop)
        until(lambda: bool(second.reasons("peer_linked")), "B is linked with A")
        yield first, second


@pytest.fixture
def come(machines: tuple[Machine, Machine]) -> Iterator[Callable[[int, str], Session]]:
    """A session of a role at A's router (0) or B's (1)."""
    with ExitStack() as stack:
        yield lambda place, name: stack.enter_context(machines[place].of(name))


Come = Callable[[int, str], Session]


def test_prometheus_is_told_of_the_router_and_the_robot_of_another_machine(
    machines: tuple[Machine, Machine], come: Come
) -> None:
    file = machines[0].log.parent / "joined.json"
    robot, other = come(1, "R3"), come(1, "R2")
    other.declare_metrics("ego-R1", "http:10.0.0.9:9102")
    robot.declare_metrics("R3", "http:10.0.0.7:9101")

    def told() -> set[str]:
        groups = json.loads(file.read_text()) if file.exists() else []
        return {group["labels"]["instance"] for group in groups}

    until(lambda: "robot-R3" in told(), "the robot at B's router is told of at A's")
    # Nothing in another's name.
    assert told() == {"robot-R3", "router-B"}


def test_words_tokens_and_questions_cross_from_machine_to_machine(come: Come) -> None:
    ego, robot = come(0, "ego-R1"), come(1, "R2")
    beacons: Inbox[Beacon] = Inbox()
    joined: Inbox[str] = Inbox()
    ego.subscribe(keyspace.beacon(SWARM, keyspace.ANY), Beacon, beacons.put)
    ego.watch_alive(joined.put, lambda _: None)
    robot.declare_alive("R2")
    assert joined.next() == "R2"
    beacon = msgspec.structs.replace(BEACON, robot="R2")

    def heard() -> bool:
        robot.put(keyspace.beacon(SWARM, "R2"), beacon)
        return not beacons.empty()

    until(heard, "A's ego hears B's robot")
    steered = msgspec.structs.replace(STEERED, robot="R2")
    robot.serve(keyspace.robot_steering(SWARM, "R2"), RobotSteering, lambda _: steered)
    operator = come(0, "operator-ann")

    def answered() -> bool:
        future = operator.ask(
            keyspace.robot_steering(SWARM, "R2"),
            RobotSteering(duty="ask"),
            RobotSteered,
            timeout_s=2.0,
            traffic=TrafficClass.CONTROL,
        )
        return future.exception() is None

    until(answered, "B's robot answers A's operator")


def test_each_router_holds_its_own_processes_to_their_rights(come: Come) -> None:
    ego, robot, reader = come(0, "ego-R1"), come(1, "R2"), come(1, "reader-bob")
    beacons: Inbox[Beacon] = Inbox()
    ego.subscribe(keyspace.beacon(SWARM, keyspace.ANY), Beacon, beacons.put)
    asked: Inbox[EgoSteering] = Inbox()

    def steer(request: EgoSteering) -> EgoSteered:
        asked.put(request)
        raise AssertionError("a reader steers")

    ego.serve(keyspace.ego_steering(SWARM, "R1"), EgoSteering, steer)
    beacon = msgspec.structs.replace(BEACON, robot="R2")

    def heard() -> bool:
        robot.put(keyspace.beacon(SWARM, "R3"), msgspec.structs.replace(BEACON, robot="R3"))
        robot.put(keyspace.beacon(SWARM, "R2"), beacon)
        return not beacons.empty()

    until(heard, "A's ego hears B's robot")
    question = reader.ask(
        keyspace.ego_steering(SWARM, "R1"),
        EgoSteering(wish=EgoWish()),
        EgoSteered,
        timeout_s=QUIET_S,
    )
    assert question.exception(WAIT_S) is not None
    assert asked.empty()
    while not beacons.empty():
        assert beacons.next().robot == "R2"


@pytest.mark.slow
def test_a_router_elsewhere_fetches_its_renewed_certificate(
    come: Come, machines: tuple[Machine, Machine], tmp_path: Path
) -> None:
    given: Inbox[str] = Inbox()

    def give(request: CertificateRequest) -> RenewedCertificate:
        given.put(request.operator)
        return RenewedCertificate(request=request.request, certificate=certificate)

    first, _ = machines
    store = first.store
    # One that is due for renewal from its beginning on.
    short = Keystore(store.folder, timedelta(seconds=32))
    folder = short.issue("router-C", (HOST,)).folder
    copy = tmp_path / "router-C"
    copy.mkdir()
    for file in folder.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    store.renew("router-C")
    certificate = (folder / "cert.pem").read_text()
    authority = come(0, "authority")
    authority.serve(keyspace.trust_certificate(SWARM), CertificateRequest, give)
    third = Machine(store, "router-C", tmp_path / "log", first, identity=Identity(copy))
    try:
        until(lambda: bool(third.reasons("certificate_renewed")), "C has its new certificate", 90.0)
    finally:
        third.stop()
    assert given.next() == "router-C"
    assert (copy / "cert.pem").read_text() == certificate


def test_a_router_of_another_swarm_is_not_linked_and_says_why(
    machines: tuple[Machine, Machine], tmp_path: Path
) -> None:
    foreign = made_keystore(tmp_path, SWARM)
    foreign.issue("router-X", (HOST,))
    stranger = Machine(foreign, "router-X", tmp_path / "log", machines[0])
    try:
        until(lambda: bool(stranger.reasons("peer_away")), "it says why", 40.0)
        assert "is not of the authority in" in stranger.reasons("peer_away")[0]
        assert not stranger.reasons("peer_linked")
    finally:
        stranger.stop()
