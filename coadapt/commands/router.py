"""`coadapt router`: run this machine's router, linked with those of other machines."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from coadapt.joining import folder_of, swarm_of
from coadapt.systemd import print_unit
from swarm import zenoh_config
from swarm.defaults import ROUTER_PORT
from swarm.errors import SettingError
from swarm.router import LOCAL_HOSTS
from swarm.trust.identity import KEY
from swarm.trust.roles import role_of


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `router` to the command line."""
    parser = subparsers.add_parser("router", help="run this machine's router", description=__doc__)
    parser.add_argument(
        "--listen", required=True, metavar="ADDRESS", help="of this machine, for its processes too"
    )
    parser.add_argument(
        "--port", type=int, default=ROUTER_PORT, help="first of three (default: %(default)s)"
    )
    parser.add_argument(
        "--peer",
        action="append",
        default=[],
        metavar="ROUTER",
        help="the router of another machine: tls/HOST[:PORT] (repeatable). Of two routers one "
        "names the other: a new machine names those that were there before",
    )
    parser.add_argument(
        "--scouting",
        action="store_true",
        help="answer who looks for a router on this network by multicast (`coadapt join scout`)",
    )
    parser.add_argument(
        "--cert",
        type=Path,
        metavar="FOLDER",
        help="its certificate, of `coadapt certs issue router-NAME --address ADDRESS`",
    )
    parser.add_argument("--swarm", help="name of the swarm (default: the certificate's)")
    parser.add_argument("--metrics-port", type=int, help="serve /metrics there, at ADDRESS")
    parser.add_argument(
        "--systemd", action="store_true", help="print a unit that does this at every boot, and end"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="of --systemd: write it there instead"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Becomes the router's process once its settings are checked."""
    folder = _identity(args)
    shown = f"#identity={folder}" if folder is not None else ""
    scheme = "tls" if folder is not None else "tcp"
    swarm = swarm_of(f"{scheme}/{args.listen}:{args.port}{shown}", args.swarm)
    peers = [zenoh_config.with_port(peer) for peer in args.peer]
    argv = ["--host", args.listen, "--port", str(args.port), "--swarm", swarm]
    argv += [word for peer in peers for word in ("--peer", peer)]
    argv += ["--identity", str(folder)] if folder is not None else []
    argv += ["--scouting"] if args.scouting else []
    argv += ["--metrics-port", str(args.metrics_port)] if args.metrics_port is not None else []
    if args.systemd:
        what, key = f"router of swarm {swarm}", folder / KEY if folder is not None else None
        print_unit(what, ["swarm.router", *argv], key, "", args.output)
        return 0
    os.execv(sys.executable, [sys.executable, "-m", "swarm.router", *argv])


def _identity(args: argparse.Namespace) -> Path | None:
    """The folder of the router's certificate; None on the loopback without one.

    Raises SettingError for an address that needs one, or a certificate of another role.
    """
    if args.cert is None:
        if args.listen not in LOCAL_HOSTS:
            raise SettingError(
                f"--listen {args.listen}: a plain router, which believes whoever reaches it, may "
                "listen on the loopback only; --cert FOLDER, of `coadapt certs issue router-NAME "
                f"--address {args.listen}` where the swarm runs, makes it a secure one"
            )
        return None
    folder = folder_of(args.cert, "router")
    if role_of(folder.name).kind != "router":
        raise SettingError(
            f"--cert {folder} is of {folder.name}, which is no router; "
            "`coadapt certs issue router-NAME --address ADDRESS` makes one"
        )
    return folder
