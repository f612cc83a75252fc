"""`coadapt steer`: another policy or Q_min, robots off duty and back, a wish by its fields."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime

import msgspec

from coadapt.arguments import add_ego, add_swarm
from coadapt.asking import ask_patiently
from coadapt.elsewhere import add_router, state_of
from coadapt.intent_flags import add_intent, intent_of
from coadapt.operator import operator
from coadapt.site import classes_of, site_of
from coadapt.wishes import NOBODY, Given, check, egos_of, line_of
from deploy.progress import typed
from deploy.spec import SwarmSpec
from deploy.state import State
from swarm import keyspace
from swarm.errors import DecisionError, DeployError, RefusedError, TransportError
from swarm.messages import (
    EgoSteered,
    EgoSteering,
    EgoWish,
    Intent,
    Message,
    RobotSteered,
    RobotSteering,
)
from swarm.messages.steer import Duty
from swarm.session import Session

CONNECT_S = 5.0


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `steer` to the command line."""
    parser = subparsers.add_parser("steer", help="change policy, Q_min, duty", description=__doc__)
    parser.add_argument("--policy", help="of the ego, from its next cycle on")
    parser.add_argument("--q-min", type=float, help="of the ego, from its next cycle on")
    parser.add_argument(
        "--stop", action="append", default=[], metavar="ROBOT", help="off duty (repeatable)"
    )
    parser.add_argument(
        "--start", action="append", default=[], metavar="ROBOT", help="on duty (repeatable)"
    )
    add_intent(parser)
    parser.add_argument(
        "--yes",
        action="store_true",
        help="stop the ego's own robot, too: it sees nothing then; leave it nobody to ask",
    )
    add_ego(parser)
    add_swarm(parser)
    add_router(parser)
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carries out what is wished, and prints how the ego decides and which robots were steered.

    Nothing is changed unless all that are named answer.
    """
    state = state_of(args)
    intent = intent_of(args)
    if intent is not None:
        return _give(args, state, intent)
    wishes = _wishes(args, state.spec)
    try:
        session = Session(state.router, state.spec.swarm, timeout_s=CONNECT_S)
    except TransportError as error:
        raise DeployError(f"the router of swarm {args.swarm!r} does not answer: {error}") from error
    with session:
        done = [wish.carry_out(session) for wish in _reached(wishes, session)]
    if args.json:
        print(msgspec.json.encode(done).decode())
        return 0
    for reply in done:
        print(_words(reply))
    return 0


def _give(args: argparse.Namespace, state: State, intent: Intent) -> int:
    """Has the ego obey the fields of an intent."""
    if args.stop or args.start:
        raise DecisionError(
            "--stop and --start are commands of their own: name no wish beside them"
        )
    named = site_of(args.site, state.spec)
    with egos_of(state) as egos:
        check(intent, egos.site(named, classes_of(state.spec)), datetime.now(UTC))
        try:
            reply = egos.ask(
                "confirm-nobody" if args.yes else "confirm", Given(intent, places=named.places)
            )
        except RefusedError as error:
            sure = "; say --yes if you mean it" if error.code == NOBODY else ""
            raise DecisionError(f"ego {state.spec.ego} refuses: {error}{sure}") from error
    (one,) = [one for one in reply.intents if one.number == reply.number]
    if args.json:
        print(msgspec.json.encode([reply]).decode())
    else:
        print(f"{reply.ego} obeys {line_of(one)}")
    return 0


def _wishes(args: argparse.Namespace, spec: SwarmSpec) -> list[_Wish]:
    """What to ask of whom. Raises DecisionError that names a value that is not allowed."""
    both = sorted(set(args.stop) & set(args.start))
    if both:
        raise DecisionError(f"robot {both[0]!r} is both to stop and to start: name it once")
    swarm = spec.swarm
    blinded = [robot for robot in spec.all_egos if robot in args.stop]
    if blinded and not args.yes:
        raise DecisionError(
            f"robot {blinded[0]!r} is the ego's own: without it the ego is blind and decides "
            "nothing that is valid; say --yes if you mean it"
        )
    by = operator()
    steering: dict[str, object] = {
        "operator": by,
        "wish": {"policy": args.policy, "q_min": args.q_min},
    }
    request, nothing = _valid(steering, EgoSteering), EgoSteering(wish=EgoWish())
    wishes = [
        _Wish(f"ego {one}", keyspace.ego_steering(swarm, one), nothing, request, EgoSteered)
        for one in (spec.ego, spec.ego_standby)
        if one
    ]
    both_ways: tuple[tuple[list[str], Duty], ...] = ((args.stop, "off"), (args.start, "on"))
    for robots, duty in both_ways:
        for robot in dict.fromkeys(robots):
            key = keyspace.robot_steering(swarm, robot)
            request_of = RobotSteering(operator=by, duty=duty)
            wishes.append(
                _Wish(f"robot {robot}", key, RobotSteering(duty="ask"), request_of, RobotSteered)
            )
    return wishes


def _reached(wishes: list[_Wish], session: Session) -> list[_Wish]:
    """Those whose process answers. Raises DeployError where one does not; of two egos, where
    neither does."""
    egos = sum(wish.kind is EgoSteered for wish in wishes)
    reached = []
    for wish in wishes:
        try:
            wish.reach(session)
            reached.append(wish)
        except DeployError:
            if wish.kind is not EgoSteered or egos == 1:
                raise
            egos -= 1
    return reached


def _valid(values: dict[str, object], kind: type[EgoSteering]) -> EgoSteering:
    try:
        return msgspec.convert(values, kind, strict=True)
    except msgspec.ValidationError as error:
        raise DecisionError(f"the wish is not valid: {error}") from error


@dataclass(frozen=True, slots=True)
class _Wish:
    """A request to one process."""

    who: str
    key: str
    nothing: Message
    """A request that only asks."""
    request: Message
    kind: type[Message]

    def reach(self, session: Session) -> None:
        """Raises DeployError where it does not answer."""
        with _faults(session, self.who):
            ask_patiently(session, self.key, self.nothing, self.kind)

    def carry_out(self, session: Session) -> Message:
        """Raises DecisionError where it refuses."""
        with _faults(session, self.who):
            return ask_patiently(session, self.key, self.request, self.kind)


@contextmanager
def _faults(session: Session, who: str) -> Iterator[None]:
    try:
        yield
    except RefusedError as error:
        raise DecisionError(f"{who} refuses: {error}") from error
    except TransportError as error:
        raise DeployError(
            f"{who} of swarm {session.swarm!r} does not answer ({error}); see "
            f"`{typed('status', session.swarm)}`"
        ) from error


def _words(reply: Message) -> str:
    if isinstance(reply, EgoSteered):
        return f"{reply.ego} decides by {reply.policy}, Q_min {reply.q_min:g}"
    assert isinstance(reply, RobotSteered)
    duty = "on duty" if reply.on_duty else "off duty"
    if not reply.operator:
        return f"{reply.robot} is {duty}"
    since = time.strftime("%H:%M:%S", time.localtime(reply.since_ns / 1e9))
    return f"{reply.robot} is {duty}, by {reply.operator} since {since}"
