"""Wishes reach the ego and the one that stands in for it; a gateway that hangs is told of."""

from __future__ import annotations

import threading
from datetime import datetime

import pytest

from coadapt.wishes import NOBODY, Egos, Given
from deploy.spec import make_spec
from ego_agent.steering import NobodyLeftError
from swarm import keyspace
from swarm.errors import DeployError, GatewayError, RefusedError
from swarm.messages import (
    EgoSteered,
    EgoSteering,
    Intent,
    IntentInForce,
    Site,
    WishAnswer,
    WishRequest,
)
from swarm.session import Session
from tests.support.zenoh_fixtures import WAIT_S, Inbox, wait_until_served

NOW = datetime.fromisoformat("2027-01-15T12:00:00+01:00")
LEAVE = Given(Intent(exclude=("R3",)), said="leave R3 alone")


class Ego:
    """Confirms whatever it is asked, under the number that it is given or 7."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.heard: Inbox[EgoSteering] = Inbox()
        self.refuses = False

    def serve(self, session: Session) -> Ego:
        key = keyspace.ego_steering(session.swarm, self.name)
        session.serve(key, EgoSteering, self._steer)
        return self

    def _steer(self, request: EgoSteering) -> EgoSteered:
        self.heard.put(request)
        if self.refuses and request.act == "confirm":
            raise NobodyLeftError("nobody is left")
        number = request.number or 7
        kept = IntentInForce(number=number, intent=request.intent or Intent())
        return EgoSteered(
            request=0,
            ego=self.name,
            policy="coverage",
            q_min=0.6,
            policies=(),
            intents=(kept,),
            number=number if request.act.startswith("confirm") else 0,
        )


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coadapt.asking.FIND_S", 0.3)


@pytest.fixture
def egos(pair: tuple[Session, Session]) -> Egos:
    session = pair[0]
    spec = make_spec(swarm=session.swarm, robots=("R1", "R2", "R3"), ego="R1", ego_standby="R2")
    return Egos(session, spec)


def reachable(pair: tuple[Session, Session], *names: str) -> None:
    for name in names:
        wait_until_served(pair[0], keyspace.ego_steering(pair[0].swarm, name))


def test_the_standby_is_given_the_wish_under_the_same_number(
    pair: tuple[Session, Session], egos: Egos
) -> None:
    first, second = Ego("R1").serve(pair[1]), Ego("R2").serve(pair[1])
    reachable(pair, "R1", "R2")
    reply = egos.ask("confirm", LEAVE)
    assert (reply.ego, reply.number) == ("R1", 7)
    asked, told = first.heard.next(), second.heard.next()
    assert (asked.act, asked.number, asked.said) == ("confirm", 0, "leave R3 alone")
    # What the first has taken, the second takes, too, whomever it hears.
    assert (told.act, told.number, told.intent) == ("confirm-nobody", 7, LEAVE.intent)
    egos.withdraw(7)
    assert [ego.heard.next().act for ego in (first, second)] == ["withdraw", "withdraw"]


def test_an_ego_that_is_away_is_left_out_and_one_that_refuses_is_heard(
    pair: tuple[Session, Session], egos: Egos
) -> None:
    with pytest.raises(DeployError, match=r"ego R1 of swarm .* does not answer"):
        egos.ask("confirm", LEAVE)
    second = Ego("R2").serve(pair[1])
    reachable(pair, "R2")
    assert egos.ask("confirm", LEAVE).ego == "R2"
    second.refuses = True
    with pytest.raises(RefusedError) as refused:
        egos.ask("confirm", LEAVE)
    assert refused.value.code == NOBODY


def test_a_gateway_that_hangs_is_told_of_in_one_sentence(
    pair: tuple[Session, Session], egos: Egos, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DEADLINE_S", "FIND_S"):
        monkeypatch.setattr(f"coadapt.understanding.{name}", 0.3)
    never = threading.Event()
    asked: Inbox[WishRequest] = Inbox()

    def hang(request: WishRequest) -> WishAnswer:
        asked.put(request)
        never.wait(WAIT_S)
        return WishAnswer(request=0, understood=Intent())

    pair[1].serve(keyspace.llm_wish(pair[1].swarm), WishRequest, hang)
    wait_until_served(pair[0], keyspace.llm_wish(pair[0].swarm))
    with pytest.raises(GatewayError, match="wishes in force stay; `coadapt steer` takes") as told:
        egos.understood("leave R3 alone", Site(robots=("R3",)), NOW)
    assert "\n" not in str(told.value)
    assert asked.next().now == NOW.isoformat()
    never.set()


def test_a_wish_of_ten_thousand_words_is_not_sent(egos: Egos) -> None:
    with pytest.raises(GatewayError, match="60000 characters; allowed: 20000"):
        egos.understood("watch " * 10_000, Site(), NOW)
