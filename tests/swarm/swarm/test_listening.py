"""What a swarm publishes is heard by the type of message, and who joins and leaves."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from swarm import keyspace
from swarm.errors import TransportError
from swarm.listening import Handlers, listen
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    GatewayState,
    Message,
    NetDemand,
    NetState,
    SceneDescription,
    TcpState,
)
from swarm.session import Session
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import WAIT_S, Inbox, RouterProcess, SessionMaker, until

KINDS = (
    *(Beacon, SceneDescription, Decision, Detections),
    *(GatewayState, NetDemand, NetState, TcpState),
)


def key_of(message: Message, swarm: str) -> str:
    """Where its own part publishes it."""
    match message:
        case Beacon(robot=robot):
            return keyspace.beacon(swarm, robot)
        case SceneDescription(robot=robot):
            return keyspace.scene(swarm, robot)
        case Decision(ego=ego):
            return keyspace.decision(swarm, ego)
        case Detections(ego=ego):
            return keyspace.detections(swarm, ego)
        case GatewayState():
            return keyspace.llm_state(swarm)
        case NetDemand():
            return keyspace.net_demand(swarm)
        case NetState(name=name):
            return keyspace.net_state(swarm, name)
    return keyspace.net_tcp(swarm)


@pytest.mark.parametrize("kind", KINDS)
def test_each_type_comes_from_where_it_is_published(
    kind: type[Message],
    shared_router: RouterProcess,
    swarm_name: str,
    open_session: SessionMaker,
) -> None:
    sample = next(one for one in SAMPLES if type(one) is kind)
    heard: Inbox[Any] = Inbox()
    speaker = open_session(shared_router.address)
    with listen(shared_router.address, swarm_name, {kind: heard.put}, timeout_s=WAIT_S):
        until(lambda: _said(speaker, sample, heard), "it is heard")
        assert heard.next() == sample


def test_of_one_ego_no_others_decisions_are_heard(
    shared_router: RouterProcess, swarm_name: str, open_session: SessionMaker
) -> None:
    own = next(one for one in SAMPLES if isinstance(one, Decision))
    other = msgspec.structs.replace(own, ego="R7", participants=("R7",))
    heard: Inbox[Any] = Inbox()
    speaker = open_session(shared_router.address)
    handlers: Handlers = {Decision: heard.put}
    with listen(shared_router.address, swarm_name, handlers, own.ego, timeout_s=WAIT_S):

        def both() -> bool:
            speaker.put(key_of(other, swarm_name), other)
            return _said(speaker, own, heard)

        until(both, "it is heard")
        assert heard.next() == own


def test_who_listens_to_an_ego_hears_the_one_that_stands_in_for_it(
    shared_router: RouterProcess, swarm_name: str, open_session: SessionMaker
) -> None:
    sample = next(one for one in SAMPLES if isinstance(one, Decision))
    first = msgspec.structs.replace(sample, ego="R1", stands_in_for=None)
    standby = msgspec.structs.replace(sample, ego="R2", stands_in_for="R1")
    frame = next(one for one in SAMPLES if isinstance(one, Detections))
    frames = {ego: msgspec.structs.replace(frame, ego=ego) for ego in ("R1", "R2")}
    decisions: Inbox[Any] = Inbox()
    detections: Inbox[Any] = Inbox()
    handlers: Handlers = {Decision: decisions.put, Detections: detections.put}
    speaker = open_session(shared_router.address)

    def heard(inbox: Inbox[Any], *messages: Message) -> list[Any]:
        """What is heard of messages that are published until something is: one may be dropped."""
        inbox.skip()

        def said() -> bool:
            for message in messages:
                speaker.put(key_of(message, swarm_name), message)
            return not inbox.empty()

        until(said, "something is heard")
        found = []
        while not inbox.empty():
            found.append(inbox.next())
        return found

    def leads(decision: Decision) -> None:
        until(lambda: heard(decisions, decision)[-1] == decision, "it is heard who leads")

    # One session hears both egos, in the order in which they speak: the wrong one speaks first.
    with listen(shared_router.address, swarm_name, handlers, "R1", timeout_s=WAIT_S):
        for leader, ego in ((first, "R1"), (standby, "R2"), (first, "R1")):
            leads(leader)
            both = sorted(frames.values(), key=lambda frame: frame.ego == ego)
            assert {frame.ego for frame in heard(detections, *both)} == {ego}


def test_who_joins_and_leaves_is_heard(
    shared_router: RouterProcess, swarm_name: str, open_session: SessionMaker
) -> None:
    events: Inbox[str] = Inbox()
    speaker = open_session(shared_router.address)
    with listen(
        shared_router.address,
        swarm_name,
        {},
        on_join=lambda robot: events.put(f"{robot} joined"),
        on_leave=lambda robot: events.put(f"{robot} left"),
        on_gateway=lambda alive: events.put(f"gateway {alive}"),
        timeout_s=WAIT_S,
    ):
        leave = speaker.declare_alive("R4")
        assert events.next() == "R4 joined"
        leave()
        assert events.next() == "R4 left"
        speaker.declare_gateway()
        assert events.next() == "gateway True"


def test_a_session_that_cannot_hear_is_closed(
    shared_router: RouterProcess, swarm_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Session] = []

    def lost(session: Session, *_: object) -> None:
        opened.append(session)
        raise TransportError("cannot declare: the session is closed")

    monkeypatch.setattr(Session, "subscribe", lost)
    with pytest.raises(TransportError, match="cannot declare"):
        listen(shared_router.address, swarm_name, {Beacon: print}, timeout_s=WAIT_S)
    assert opened[0].links() == 0


def _said(speaker: Session, message: Message, heard: Inbox[Any]) -> bool:
    """Says it once more; whether it has come: a subscription takes a moment to be known."""
    speaker.put(key_of(message, speaker.swarm), message)
    return not heard.empty()
