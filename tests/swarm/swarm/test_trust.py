"""Sessions of a secure swarm: as whom they speak, and certificates that change meanwhile."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from urllib.request import urlopen

import msgspec
import pytest

from deploy.trust.copies import Copies
from deploy.trust.keystore import Keystore
from swarm import keyspace
from swarm.errors import CoAdaptError, IdentityError, RefusedError, TransportError
from swarm.log import make_logger
from swarm.messages import (
    Beacon,
    Message,
    Observation,
    ObservationRequest,
    RobotSteered,
    RobotSteering,
    encode,
)
from swarm.session import Session
from swarm.trust.certificates import check, read_certificate
from swarm.trust.identity import Identity
from swarm.trust.renewal import Renewal
from tests.support.free_ports import free_port
from tests.support.message_samples import SAMPLES
from tests.support.secure_swarm import HOST, SecureRouter, made_keystore, secure_router
from tests.support.zenoh_fixtures import WAIT_S, Inbox, SessionMaker, until

NAMES = ("R1", "R3", "ego-R1", "ego-R2", "console", "operator-ann")


def sample(kind: type[Message]) -> Message:
    return next(message for message in SAMPLES if isinstance(message, kind))


def beacon(robot: str, seq: int) -> Beacon:
    found = sample(Beacon)
    assert isinstance(found, Beacon)
    return msgspec.structs.replace(found, robot=robot, seq=seq)


@pytest.fixture
def store(tmp_path: Path, swarm_name: str) -> Keystore:
    return made_keystore(tmp_path / "keystore", swarm_name, *NAMES)


@pytest.fixture
def router(store: Keystore, swarm_name: str) -> Iterator[SecureRouter]:
    with secure_router(store, swarm_name) as router:
        yield router


def steered(robot: Session, heard: list[str]) -> None:
    def steer(request: RobotSteering) -> RobotSteered:
        heard.append(request.operator)
        return RobotSteered(
            robot="R3", request=0, on_duty=True, since_ns=0, operator=request.operator
        )

    robot.serve(keyspace.robot_steering(robot.swarm, "R3"), RobotSteering, steer)


def test_who_steered_is_who_the_certificate_says(
    router: SecureRouter, open_session: SessionMaker
) -> None:
    heard: list[str] = []
    steered(robot := open_session(router.of("R3")), heard)
    key = keyspace.robot_steering(robot.swarm, "R3")
    for name in ("operator-ann", "console"):
        session = open_session(router.of(name))
        request = RobotSteering(operator="up", duty="off")

        def asked(session: Session = session, request: RobotSteering = request) -> bool:
            try:
                session.ask(key, request, RobotSteered, timeout_s=1.0).result()
            except TransportError:
                return False
            return True

        until(asked, "an answer")
    assert set(heard) == {"operator-ann", "console"}


def test_an_ego_asks_in_its_own_name_only(router: SecureRouter, open_session: SessionMaker) -> None:
    robot, ego = open_session(router.of("R3")), open_session(router.of("ego-R2"))
    observation = sample(Observation)
    robot.serve(
        keyspace.observation(robot.swarm, "R3"), ObservationRequest, lambda request: observation
    )
    key = keyspace.observation(robot.swarm, "R3")
    own = ObservationRequest(ego="R2", request=1, algorithm="late", capture_ns=0)

    def answered() -> bool:
        try:
            return bool(ego.ask(key, own, Observation, timeout_s=1.0).result().wire_bytes)
        except TransportError:
            return False

    until(answered, "an answer")
    claimed = ObservationRequest(ego="R1", request=2, algorithm="late", capture_ns=0)
    with pytest.raises(RefusedError, match="ego-R2 asks in the name of ego 'R1'"):
        ego.ask(key, claimed, Observation, timeout_s=WAIT_S).result()


def test_an_impostor_that_came_first_answers_nothing(
    router: SecureRouter, open_session: SessionMaker
) -> None:
    impostor, ego = open_session(router.of("R1")), open_session(router.of("ego-R1"))
    asked: list[int] = []
    key = keyspace.observation(ego.swarm, "R3")

    def answer(request: ObservationRequest) -> Message:
        asked.append(request.request)
        return sample(Observation)

    impostor.serve(keyspace.observation(ego.swarm, "R1"), ObservationRequest, answer)
    impostor.serve(key, ObservationRequest, answer)
    own = ObservationRequest(ego="R1", request=0, algorithm="late", capture_ns=0)

    def its_own_is_answered() -> bool:
        try:
            ego.ask(keyspace.observation(ego.swarm, "R1"), own, Observation, timeout_s=1.0).result()
        except TransportError:
            return False
        return True

    until(its_own_is_answered, "what it may serve")
    asked.clear()
    for number in range(40):
        request = ObservationRequest(ego="R1", request=number, algorithm="late", capture_ns=0)
        with pytest.raises(TransportError, match="no answer"):
            ego.ask(key, request, Observation, timeout_s=0.2).result()
    assert not asked


def test_a_strangers_words_and_tokens_are_not_passed_on(
    router: SecureRouter, open_session: SessionMaker
) -> None:
    liar, ego = open_session(router.of("R1")), open_session(router.of("ego-R1"))
    heard: Inbox[Beacon] = Inbox()
    joined: Inbox[str] = Inbox()
    ego.subscribe(keyspace.beacon(ego.swarm, keyspace.ANY), Beacon, heard.put)
    ego.watch_alive(joined.put, lambda robot: None)
    liar.declare_alive("R3")
    liar.declare_alive("R1")

    def told() -> bool:
        liar.put(keyspace.beacon(liar.swarm, "R3"), beacon("R3", 1))
        liar._connection.zenoh.put(f"coadapt/{liar.swarm}/robot/*/beacon", encode(beacon("R3", 2)))
        liar.put(keyspace.beacon(liar.swarm, "R1"), beacon("R1", 1))
        return not heard.empty()

    until(told, "R1's own beacon")
    assert joined.next() == "R1"
    while not heard.empty():
        assert heard.next().robot == "R1"
    assert joined.empty()
    assert ego.alive() == ("R1",)


def test_a_renewed_certificate_is_shown_without_a_word_lost(
    router: SecureRouter, open_session: SessionMaker, store: Keystore
) -> None:
    robot, ego = open_session(router.of("R3")), open_session(router.of("ego-R1"))
    heard: list[int] = []
    left: list[str] = []
    ego.subscribe(
        keyspace.beacon(ego.swarm, keyspace.ANY), Beacon, lambda told: heard.append(told.seq)
    )
    ego.watch_alive(lambda robot: None, left.append)
    robot.declare_alive("R3")
    said = 0

    def say() -> bool:
        nonlocal said
        said += 1
        robot.put(keyspace.beacon(robot.swarm, "R3"), beacon("R3", said))
        return bool(heard)

    until(say, "the first beacon")
    begun = heard[0]
    store.renew("R3")
    store.renew("ego-R1")

    def shown() -> bool:
        say()
        return robot._connection.reopened == ego._connection.reopened == 1

    until(shown, "both show the new certificate")
    say()
    last = said
    until(lambda: last in heard, "the last beacon")
    assert set(range(begun, last)) <= set(heard)
    assert left == []


def test_a_router_with_a_new_certificate_has_everybody_back(
    router: SecureRouter, open_session: SessionMaker, store: Keystore
) -> None:
    robot, ego = open_session(router.of("R3")), open_session(router.of("ego-R1"))
    robot.declare_alive("R3")
    until(lambda: ego.alive() == ("R3",), "R3 is seen")
    joined: Inbox[str] = Inbox()
    left: Inbox[str] = Inbox()
    ego.watch_alive(joined.put, left.put)
    assert joined.next() == "R3"
    store.renew("router")
    assert left.next() == "R3"
    assert joined.next() == "R3"
    until(lambda: robot.links() == ego.links() == 3, "all links")


def test_the_revoked_lose_what_they_had(
    router: SecureRouter, open_session: SessionMaker, store: Keystore
) -> None:
    robot, other, ego = (open_session(router.of(name)) for name in ("R3", "R1", "ego-R1"))
    heard: list[str] = []
    ego.subscribe(
        keyspace.beacon(ego.swarm, keyspace.ANY), Beacon, lambda told: heard.append(told.robot)
    )
    said = 0

    def speak() -> None:
        nonlocal said
        said += 1
        for session, name in ((robot, "R3"), (other, "R1")):
            session.put(keyspace.beacon(session.swarm, name), beacon(name, said))

    def both() -> bool:
        heard.clear()
        speak()
        time.sleep(0.05)
        return {"R1", "R3"} <= set(heard)

    def only_the_other() -> bool:
        heard.clear()
        for _ in range(10):
            speak()
            time.sleep(0.02)
        return set(heard) == {"R1"}

    until(both, "both are heard")
    store.revoke("R3")
    until(only_the_other, "only R1 is heard", 2 * WAIT_S)
    store.issue("R3", again=True)
    until(both, "both are heard again", 2 * WAIT_S)


def test_a_certificate_that_ends_ends_the_connection(
    tmp_path: Path, swarm_name: str, open_session: SessionMaker
) -> None:
    store = made_keystore(tmp_path / "keystore", swarm_name)
    with secure_router(store, swarm_name) as router:
        Keystore(store.folder, timedelta(seconds=10)).issue("R1")
        robot = open_session(router.of("R1"))
        assert robot.links() > 0
        until(lambda: robot.links() == 0, "the links are cut", 60.0)
        with pytest.raises(IdentityError, match=r"of R1 ended at .*`coadapt certs issue R1` makes"):
            open_session(router.of("R1"))
        store.issue("R1")
        until(lambda: robot.links() > 0, "the links are back", 60.0)


def test_both_sides_say_why_a_session_is_refused(
    store: Keystore, swarm_name: str, tmp_path: Path
) -> None:
    foreign = made_keystore(tmp_path / "foreign", swarm_name, "R3")
    port = free_port()
    with secure_router(store, swarm_name, "--metrics-port", str(port)) as router:
        other = f"tls/127.0.0.1:{router.port}#identity={foreign.identity('R3').folder}"
        with pytest.raises(TransportError, match=r"is not of the authority in .*ca\.pem"):
            Session(other, swarm_name, timeout_s=5.0)
        router.says("received fatal alert")
        with pytest.raises(TransportError, match=r"a secure one wants tls/HOST:PORT#identity="):
            Session(router.address, swarm_name, timeout_s=5.0)
        router.says("received corrupt message")
        told = urlopen(f"http://{HOST}:{port}/metrics", timeout=WAIT_S).read().decode()
        (refused,) = re.findall(r"^coadapt_router_refused_links_total (\S+)$", told, re.M)
        assert float(refused) > 1


def test_an_identity_on_another_machine_is_renewed_over_the_network(
    store: Keystore, router: SecureRouter, open_session: SessionMaker, tmp_path: Path
) -> None:
    store.issue("authority")
    elsewhere = Identity(Path(shutil.copytree(store.identity("R3").folder, tmp_path / "R3")))
    session = open_session(f"tls/{HOST}:{router.port}#identity={elsewhere.folder}")
    log = make_logger("authority")
    copies = Copies(store, router.of("authority"), session.swarm, log)
    renewal = Renewal(elsewhere, session._certificate, log, share=1.0)
    try:
        before = read_certificate(elsewhere.certificate)
        until(
            lambda: store.renew("R3") > before.not_valid_after_utc,
            "it ends later: certificates tell whole seconds",
        )
        after = read_certificate(store.identity("R3").certificate)
        until(lambda: read_certificate(elsewhere.certificate) == after, "it is here", 60.0)
        check(elsewhere)
        until(lambda: session._connection.reopened == 1, "the session shows it", 60.0)
        store.revoke("R3")
        with pytest.raises(CoAdaptError):
            session._certificate()
    finally:
        renewal.close()
        copies.close()


def test_a_certificate_that_is_not_ones_own_is_not_taken(
    store: Keystore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foreign = made_keystore(tmp_path / "foreign", "other", "R3")
    mine = store.identity("R3")
    held = mine.certificate.read_bytes()
    for other in (store.identity("R1"), foreign.identity("R3")):
        text = other.certificate.read_text()
        renewal = Renewal(mine, lambda text=text: text, make_logger("r"), share=1.0)  # type: ignore[misc]
        until(lambda: "certificate_not_renewed" in capsys.readouterr().err, "that is said")
        renewal.close()
    assert mine.certificate.read_bytes() == held


def started(*argv: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *argv],
        env={**environment, "PATH": ""},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_a_router_without_its_certificate_says_so_and_ends(store: Keystore) -> None:
    identity = store.identity("router")
    identity.key.unlink()
    argv = ["swarm.router", "--port", "1", "--identity", str(identity.folder)]
    done = started(*argv, "--swarm", "qa")
    assert done.returncode == 1
    assert f"{identity.key}, the key of router, cannot be read" in done.stderr
    assert "`coadapt certs issue router` makes a new one" in done.stderr
    assert "--identity needs --swarm" in started(*argv).stderr


@pytest.mark.parametrize(
    ("module", "setting"),
    [
        ("robot_agent", {"COADAPT_ROBOTS": "R3"}),
        ("ego_agent", {"COADAPT_EGO": "R3"}),
        ("network_controller", {}),
        ("llm_gateway", {}),
        ("options.console", {"COADAPT_EGO": "R3"}),
    ],
)
def test_a_process_with_anothers_certificate_says_so_and_ends(
    store: Keystore, module: str, setting: dict[str, str]
) -> None:
    router = f"tls/127.0.0.1:1#identity={store.identity('R1').folder}"
    done = started(module, COADAPT_ROUTER=router, **setting)
    assert done.returncode == 1
    assert "names the identity of 'R1', and this process is" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
