"""`coadapt cpm`: Collective Perception Messages of ETSI TS 103 324, for vehicles of others."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

import msgspec

from coadapt.arguments import add_ego, add_swarm
from coadapt.elsewhere import add_router, state_of
from deploy.progress import say
from swarm.errors import SettingError
from swarm.process import stop_on_signals

_TO = re.compile(r"(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>[0-9]{1,5})")
MAX_STATION = 2**32 - 1


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `cpm` to the command line."""
    parser = subparsers.add_parser(
        "cpm",
        help="send and read ETSI's Collective Perception Messages",
        description="Collective Perception Messages (ETSI TS 103 324 V2.1.1, ASN.1 UPER): sends "
        "what an ego found, by the standard's generation rules, and reads messages.",
    )
    actions = parser.add_subparsers(dest="action", required=True)
    bring = actions.add_parser("modules", help="bring ETSI's ASN.1 modules, once")
    bring.add_argument("--source", metavar="URL", help="where they are, https: or file:")
    bring.set_defaults(run=run_modules)
    send = actions.add_parser("send", help="send an ego's objects over UDP")
    send.add_argument("to", metavar="HOST:PORT", help="where each message goes as one datagram")
    send.add_argument(
        "--origin",
        required=True,
        metavar="LAT,LON",
        help="where the world's origin lies, degrees; its x points east",
    )
    send.add_argument("--station", type=int, default=1, metavar="N", help="identifier (default: 1)")
    add_ego(send)
    add_swarm(send)
    add_router(send)
    send.set_defaults(run=run_send)
    read = actions.add_parser("read", help="print a message as JSON")
    read.add_argument("file", type=Path, metavar="FILE", help="one message in UPER")
    read.set_defaults(run=run_read)


def run_modules(args: argparse.Namespace) -> int:
    """Brings and checks the modules. Raises SettingError where they cannot be had."""
    from options.etsi.modules import URL, bring

    print(f"the ASN.1 modules of ETSI are in {bring(args.source or URL)}")
    return 0


def run_send(args: argparse.Namespace) -> int:
    """Sends until it is stopped. Raises SettingError for what cannot be used."""
    from options.etsi.anchor import parse_anchor
    from options.etsi.station import Station
    from options.etsi.telling import send

    found = _TO.fullmatch(args.to)
    if found is None or not 0 < int(found["port"]) < 65_536:
        raise SettingError(f"{args.to!r} is not valid; it must be HOST:PORT, like 10.0.0.9:4401")
    if not 0 <= args.station <= MAX_STATION:
        raise SettingError(f"--station {args.station} is not valid; allowed: 0 to {MAX_STATION}")
    station = Station(args.station, parse_anchor(args.origin))
    state = state_of(args)
    to = (found["host"].strip("[]"), int(found["port"]))
    sent = send(state.router, state.spec.swarm, state.spec.ego, station, to, stop_on_signals(), say)
    say(f"ended: {sent.ended}")
    if sent.fault:
        say(f"{sent.left_out} frames were left out: {sent.fault}")
    print(f"{sent.messages} messages with {sent.objects} objects, {sent.bytes} bytes")
    return 0


def run_read(args: argparse.Namespace) -> int:
    """Prints one message. Raises PayloadError for a file that is none."""
    from options.etsi.message import decode

    try:
        data = args.file.read_bytes()
    except OSError as error:
        raise SettingError(f"{args.file} cannot be read: {error}") from error
    told: Any = msgspec.to_builtins(decode(data))
    print(msgspec.json.format(msgspec.json.encode(told), indent=1).decode())
    return 0
