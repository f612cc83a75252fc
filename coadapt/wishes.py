"""Giving an ego an intent, and the one that stands in for it, too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime

import msgspec

from coadapt.asking import ask_patiently
from coadapt.operator import operator
from coadapt.understanding import understood
from deploy.progress import typed
from deploy.spec import SwarmSpec
from deploy.state import State
from swarm import keyspace
from swarm.errors import (
    DecisionError,
    DeployError,
    IdentityError,
    RefusedError,
    TransportError,
)
from swarm.intent_words import in_words
from swarm.messages import (
    EgoSteered,
    EgoSteering,
    EgoWish,
    Intent,
    IntentInForce,
    Place,
    Site,
    problems,
)
from swarm.messages.steer import IntentAct
from swarm.session import Session
from swarm.site_file import SiteFile
from swarm.trust.roles import role_of

CONNECT_S = 5.0
NOBODY = "nobody"
"""The code with which an ego refuses an intent that leaves nobody to ask."""


@dataclass(frozen=True, slots=True)
class Given:
    """An intent with what an ego needs to obey it."""

    intent: Intent
    said: str = ""
    """The words that it was understood from."""
    places: tuple[Place, ...] = ()
    """The site's."""


@contextmanager
def egos_of(state: State) -> Iterator[Egos]:
    """The egos of a swarm that runs. Raises DeployError where its router does not answer,
    IdentityError for a certificate that may only look."""
    spec = state.spec
    try:
        session = Session(state.router, spec.swarm, timeout_s=CONNECT_S)
    except TransportError as error:
        raise DeployError(f"the router of swarm {spec.swarm!r} does not answer: {error}") from error
    with session:
        # The router lets none of its requests through: nobody would say why.
        if session.name and role_of(session.name).kind == "reader":
            raise IdentityError(
                f"{session.name} may only look at swarm {spec.swarm!r}; wishes need the "
                "certificate of an operator: `coadapt certs issue operator-NAME`"
            )
        yield Egos(session, spec)


class Egos:
    """The ego that decides, and the one that stands in for it."""

    def __init__(self, session: Session, spec: SwarmSpec) -> None:
        self._session = session
        self._names = [spec.ego, *([spec.ego_standby] if spec.ego_standby else [])]
        self._robots = spec.robots
        self.operator = session.name or operator()
        """Whom the egos are told; in a secure swarm, whose certificate it is."""

    def in_force(self) -> EgoSteered:
        """What the first ego that answers obeys. Raises DeployError where none does."""
        return self._each(EgoSteering(operator=self.operator, wish=EgoWish()))[0]

    def site(self, named: SiteFile, classes: Sequence[str]) -> Site:
        """The names that a wish may use here."""
        robots = dict.fromkeys((*self._robots, *self._session.alive()))
        return Site(
            robots=tuple(robots),
            places=named.names(),
            classes=tuple(classes),
            words=named.words,
        )

    def ask(self, act: IntentAct, given: Given) -> EgoSteered:
        """Tries or confirms an intent. Raises RefusedError where the ego refuses, DeployError where
        none answers."""
        request = EgoSteering(
            operator=self.operator,
            wish=EgoWish(),
            act=act,
            intent=given.intent,
            said=given.said,
            places=given.places,
        )
        return self._each(request)[0]

    def understood(self, wish: str, site: Site, now: datetime) -> Intent:
        """What a wish means. Raises GatewayError where nobody can tell."""
        return understood(self._session, wish, site, now, self.operator)

    def withdraw(self, number: int) -> EgoSteered:
        """Ends an intent. Raises RefusedError where no ego has it, DeployError where none
        answers."""
        request = EgoSteering(operator=self.operator, wish=EgoWish(), act="withdraw", number=number)
        return self._each(request)[0]

    def _each(self, request: EgoSteering) -> list[EgoSteered]:
        """The replies, the first ego's first. The second is told the number that the first gave; it
        need not answer."""
        replies: list[EgoSteered] = []
        trouble: TransportError | None = None
        for name in self._names:
            try:
                reply = ask_patiently(
                    self._session,
                    keyspace.ego_steering(self._session.swarm, name),
                    request,
                    EgoSteered,
                )
            except RefusedError:
                if replies:
                    continue
                raise
            except TransportError as error:
                trouble = error
                continue
            replies.append(reply)
            if reply.number:
                sure: IntentAct = "confirm-nobody" if request.act == "confirm" else request.act
                request = msgspec.structs.replace(request, number=reply.number, act=sure)
        if not replies:
            raise DeployError(
                f"ego {self._names[0]} of swarm {self._session.swarm!r} does not answer "
                f"({trouble}); see `{typed('status', self._session.swarm)}`"
            ) from trouble
        return replies


def check(intent: Intent, site: Site, now: datetime) -> None:
    """Raises DecisionError that says what of an intent a site does not have, or contradicts."""
    if intent.is_empty():
        raise DecisionError("the intent wishes nothing")
    if found := problems(intent, site, now):
        raise DecisionError("; ".join(found))


def listed(reply: EgoSteered) -> str:
    """The intents of an ego, for people, one a line."""
    return "\n".join(map(line_of, reply.intents)) or f"{reply.ego} obeys no wish"


def line_of(one: IntentInForce) -> str:
    """One intent in force, for people."""
    since = datetime.fromtimestamp(one.since_ns * 1e-9, UTC).astimezone()
    return (
        f"wish {one.number} of {one.operator or 'unknown'} since {since:%Y-%m-%d %H:%M}: "
        f"{in_words(one.intent)}"
    )


def read_back(given: Given, reply: EgoSteered) -> str:
    """What an intent says, and what it would have changed, for people."""
    said, *effect = reply.says
    lines = [f"understood  {said}"]
    lines += [f"not clear   {words!r}" for words in given.intent.unclear]
    lines += [f"effect      {line}" for line in effect]
    return "\n".join(lines)
