"""`coadapt net`: shape links, fill them with telemetry, and see what they carry."""

from __future__ import annotations

import argparse
import re
import time
from pathlib import Path

import msgspec

from coadapt.arguments import add_swarm
from coadapt.elsewhere import add_router, state_of
from coadapt.net_client import NetClient
from coadapt.net_view import render
from coadapt.operator import operator
from deploy.rates import parse_link_rate, parse_seconds, parse_share
from network_controller.mahimahi import read_trace
from swarm import keyspace
from swarm.controllers import merged, of
from swarm.errors import DeployError, NetworkError, TransportError
from swarm.messages import ShapeRequest
from swarm.messages.net import MAX_DURATION_S
from swarm.session import Session

CONNECT_S = 5.0
MAX_DELAY_S, MAX_LOSS = 10.0, 0.5
"""As `ShapeRequest` allows."""
_NEGATIVE = re.compile(r"-\.?\d")


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `net` to the command line."""
    parser = subparsers.add_parser("net", help="shape and watch links", description=__doc__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    shape = commands.add_parser("shape", help="give a link a rate or a profile")
    what = shape.add_mutually_exclusive_group(required=True)
    what.add_argument("--rate", help="like 5mbit")
    what.add_argument("--profile", choices=("shift", "trace", "off"))
    shape.add_argument("--trace", metavar="FILE", help="of profile trace: Mahimahi's format")
    shape.add_argument(
        "--interval", type=float, help="of profile trace: seconds of each rate (default: 1)"
    )
    shape.add_argument(
        "--time-scale",
        type=float,
        help="of profiles shift and trace: seconds of theirs a second (default: 1)",
    )
    shape.add_argument("--delay", help="like 20ms; needs netem")
    shape.add_argument("--loss", help="like 1%%; needs netem")
    shape.add_argument(
        "--direction",
        choices=("down", "up", "both"),
        help="to the robot or from it (default: down; of profile off: both)",
    )
    shape.set_defaults(request=_shape)
    congest = commands.add_parser("congest", help="send competing telemetry for a while")
    congest.add_argument("--rate", help="like 4mbit (default: 85%% of the link)")
    congest.add_argument("--protocol", choices=("udp", "tcp", "both"), default="both")
    congest.add_argument(
        "--stop", action="store_true", help="end it; without --robot towards everybody"
    )
    congest.set_defaults(request=_congest)
    show = commands.add_parser("show", help="shapes in force, and what links carry")
    show.set_defaults(request=_show)
    for one in (shape, congest):
        one.add_argument("--robot", help="whose link (default: the ego's cell)")
        one.add_argument("--for", dest="duration", help="like 60s, 10m, 1h; then it ends")
        one.add_argument(
            "--if-revision", type=int, help="only if nobody else has changed the shapes since"
        )
        # A negative rate is a wrong rate, which its own message explains; not an option.
        one._negative_number_matcher = _NEGATIVE
    for one in (shape, congest, show):
        add_swarm(one)
        add_router(one)
        one.add_argument("--json", action="store_true", help="one object on standard output")
        one.set_defaults(run=run, parser=one)


def run(args: argparse.Namespace) -> int:
    """Asks the network controller, and prints what is in force afterwards."""
    request: ShapeRequest = args.request(args)
    swarm = state_of(args)
    try:
        session = Session(swarm.router, swarm.spec.swarm, timeout_s=CONNECT_S)
    except TransportError as error:
        raise DeployError(f"the router of swarm {args.swarm!r} does not answer: {error}") from error
    show = request.profile == "show"
    with session:
        client = NetClient(session, swarm.spec.ego)
        replies = client.ask(request)
        links = client.links() if show else ()
        states = client.states() if show else {}
    if args.json:
        table = msgspec.to_builtins(merged(replies))
        table["revisions"] = {name: reply.revision for name, reply in replies.items()}
        if show:
            table["links"] = msgspec.to_builtins(links)
            table["state_ns"] = max((state.sent_ns for state in states.values()), default=None)
            table["controllers"] = [
                {"name": name, "robots": state.robots, "unshaped": state.unshaped}
                for name, state in states.items()
            ]
        print(msgspec.json.encode(table).decode())
        return 0
    print(render(replies, links, time.time_ns()))
    for name, state in states.items():
        for why in state.unshaped:
            print(f"note: {of(name)}{why}; C(t) is only measured there")
    if show and not states:
        print("note: no net/state came: nothing is known of what links carry")
    return 0


def _shape(args: argparse.Namespace) -> ShapeRequest:
    _check_usage(args)
    off = args.profile == "off"
    interval_s = 1.0 if args.interval is None else args.interval
    return _request(
        args,
        profile=args.profile or "rate",
        direction=args.direction or ("both" if off else "down"),
        rate_bps=None if args.rate is None else parse_link_rate(args.rate),
        rates_bps=() if args.trace is None else read_trace(Path(args.trace), interval_s),
        interval_s=interval_s,
        time_scale=1.0 if args.time_scale is None else args.time_scale,
        delay_ms=0.0 if args.delay is None else parse_seconds(args.delay, MAX_DELAY_S) * 1e3,
        loss=0.0 if args.loss is None else parse_share(args.loss, MAX_LOSS),
    )


def _check_usage(args: argparse.Namespace) -> None:
    """Ends with the usage (exit status 2) where options do not belong together."""
    if args.profile == "trace" and args.trace is None:
        args.parser.error("--profile trace needs --trace FILE")
    takers = {
        "--trace": (args.trace, ("trace",)),
        "--interval": (args.interval, ("trace",)),
        "--time-scale": (args.time_scale, ("shift", "trace")),
        "--delay": (args.delay, ("shift", "trace", None)),
        "--loss": (args.loss, ("shift", "trace", None)),
        "--for": (args.duration, ("shift", "trace", None)),
    }
    for option, (value, profiles) in takers.items():
        if value is not None and args.profile not in profiles:
            what = f"--profile {args.profile}" if args.profile else "--rate"
            args.parser.error(f"{option} does not go with {what}")


def _congest(args: argparse.Namespace) -> ShapeRequest:
    if args.stop:
        for option, value in (("--rate", args.rate), ("--for", args.duration)):
            if value is not None:
                args.parser.error(f"{option} does not go with --stop")
        return _request(args, profile="relieve")
    return _request(
        args,
        profile="congest",
        rate_bps=None if args.rate is None else parse_link_rate(args.rate),
        protocol=args.protocol,
    )


def _show(args: argparse.Namespace) -> ShapeRequest:
    return ShapeRequest(profile="show", operator=operator())


def _request(args: argparse.Namespace, **values: object) -> ShapeRequest:
    """A request whose values are in range. Raises CoAdaptError that names the value."""
    common = {
        "operator": operator(),
        "robot": "" if args.robot is None else keyspace.check_name("robot id", args.robot),
        "duration_s": (
            None if args.duration is None else parse_seconds(args.duration, MAX_DURATION_S)
        ),
        "revision": args.if_revision,
    }
    try:
        return msgspec.convert(common | values, ShapeRequest, strict=True)
    except msgspec.ValidationError as error:
        raise NetworkError(f"the request is not valid: {error}") from error
