"""`coadapt net`: shape links, fill them with telemetry, and see what they carry."""

from __future__ import annotations

import argparse
import getpass
import socket
import time
from pathlib import Path

import msgspec

from coadapt.net_view import render
from deploy.rates import parse_link_rate, parse_rate, parse_seconds, parse_share
from deploy.state import need_state
from network_controller.mahimahi import read_trace
from swarm import keyspace
from swarm.errors import NetworkError, TransportError
from swarm.messages import NetState, ShapeReply, ShapeRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

CONNECT_S = 5.0
ANSWER_S = 15.0
STATE_S = 2.5
"""Two periods of `net/state` and some."""


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `net` to the command line."""
    parser = subparsers.add_parser("net", help="shape and watch links", description=__doc__)
    commands = parser.add_subparsers(dest="net_command", required=True)
    shape = commands.add_parser("shape", help="give a link a rate or a profile")
    what = shape.add_mutually_exclusive_group(required=True)
    what.add_argument("--rate", help="like 5mbit")
    what.add_argument("--profile", choices=("shift", "trace", "off"))
    shape.add_argument("--trace", metavar="FILE", help="of profile trace: Mahimahi's format")
    shape.add_argument("--interval", type=float, default=1.0, help="seconds that a rate lasts")
    shape.add_argument("--time-scale", type=float, default=1.0, help="profile seconds a second")
    shape.add_argument("--delay", help="like 20ms; needs netem")
    shape.add_argument("--loss", help="like 1%%; needs netem")
    shape.add_argument("--direction", choices=("down", "up", "both"), default="down")
    shape.set_defaults(request=_shape)
    congest = commands.add_parser("congest", help="send competing telemetry for a while")
    congest.add_argument("--rate", help="like 4mbit (default: 85%% of the link)")
    congest.add_argument("--protocol", choices=("udp", "tcp", "both"), default="both")
    congest.set_defaults(request=_congest)
    show = commands.add_parser("show", help="shapes in force, and what links carry")
    show.set_defaults(request=lambda args: ShapeRequest(profile="show", operator=_operator()))
    for one in (shape, congest):
        one.add_argument("--robot", default="", help="whose link (default: the ego's cell)")
        one.add_argument("--for", dest="duration", help="like 60s, 10m, 1h; then it ends")
        one.add_argument(
            "--if-revision", type=int, help="only if nobody else has changed the shapes since"
        )
    for one in (shape, congest, show):
        one.add_argument("--swarm", default="local", help="name of the swarm (default: local)")
        one.add_argument("--json", action="store_true", help="one object on standard output")
        one.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Asks the network controller, and prints what is in force afterwards."""
    request: ShapeRequest = args.request(args)
    state = need_state(args.swarm)
    with Session(state.router, state.spec.swarm, timeout_s=CONNECT_S) as session:
        watch = _States(session) if request.profile == "show" else None
        reply = _ask(session, request)
        links = watch.newest() if watch is not None else None
    if args.json:
        table = msgspec.to_builtins(reply)
        if links is not None:
            table["links"] = msgspec.to_builtins(links.links)
        print(msgspec.json.encode(table).decode())
    else:
        print(render(reply, links.links if links is not None else None, time.time_ns()))
    return 0


class _States:
    """Keeps the newest `net/state` of each controller."""

    def __init__(self, session: Session) -> None:
        self._newest: NetState | None = None
        session.subscribe(keyspace.net_state(session.swarm), NetState, self._on_state)

    def _on_state(self, state: NetState, _: str) -> None:
        self._newest = state

    def newest(self) -> NetState | None:
        """What came last, waiting for the first one."""
        until = time.monotonic() + STATE_S
        while self._newest is None and time.monotonic() < until:
            time.sleep(0.05)
        return self._newest


def _ask(session: Session, request: ShapeRequest) -> ShapeReply:
    """The controller's reply. Raises its refusal, or that there is no controller."""
    key = keyspace.net_shape(session.swarm)
    until = time.monotonic() + CONNECT_S
    while True:
        future = session.ask(
            key, request, ShapeReply, timeout_s=ANSWER_S, traffic=TrafficClass.CONTROL
        )
        try:
            return future.result().message
        except TransportError as error:
            # A controller that has just started may not be known to the router yet.
            if "nobody serves it" not in str(error):
                raise NetworkError(str(error).partition(" refused: ")[2] or str(error)) from error
            if time.monotonic() > until:
                raise NetworkError(
                    f"no network controller answers in swarm {session.swarm!r}; see "
                    "`coadapt status` and `coadapt logs controller`"
                ) from error
            time.sleep(0.2)


def _shape(args: argparse.Namespace) -> ShapeRequest:
    if (args.profile == "trace") != (args.trace is not None):
        raise NetworkError("profile trace and --trace FILE go together")
    if args.profile == "off" and (args.delay or args.loss or args.duration):
        raise NetworkError("profile off takes no --delay, --loss or --for")
    return _request(
        profile=args.profile or "rate",
        robot=args.robot,
        direction=args.direction,
        rate_bps=parse_link_rate(args.rate) if args.rate else None,
        rates_bps=read_trace(Path(args.trace), args.interval) if args.trace else (),
        interval_s=args.interval,
        time_scale=args.time_scale,
        duration_s=parse_seconds(args.duration) if args.duration else None,
        delay_ms=parse_seconds(args.delay) * 1e3 if args.delay else 0.0,
        loss=parse_share(args.loss) if args.loss else 0.0,
        revision=args.if_revision,
    )


def _congest(args: argparse.Namespace) -> ShapeRequest:
    return _request(
        profile="congest",
        robot=args.robot,
        rate_bps=parse_rate(args.rate) if args.rate else None,
        duration_s=parse_seconds(args.duration) if args.duration else None,
        protocol=args.protocol,
        revision=args.if_revision,
    )


def _request(**values: object) -> ShapeRequest:
    """A request whose values are in range. Raises NetworkError that names the field."""
    try:
        request: ShapeRequest = msgspec.convert(
            {"operator": _operator(), **values}, ShapeRequest, strict=True
        )
    except msgspec.ValidationError as error:
        raise NetworkError(f"the request is not valid: {error}") from error
    return request


def _operator() -> str:
    """Who asks, as it stands in the controller's journal."""
    try:
        return f"{getpass.getuser()}@{socket.gethostname()}"[:64]
    except (OSError, KeyError):
        return "unknown"
