"""`coadapt certs init|issue|list|revoke`: who may take part in a secure swarm."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import msgspec

from coadapt.arguments import add_swarm
from coadapt.commands.status import columns
from deploy.progress import typed
from deploy.spec import var_dir_of
from deploy.state import read_state
from swarm.errors import DeployError
from swarm.keyspace import check_name
from swarm.trust.roles import RULE, role_of

if TYPE_CHECKING:
    from deploy.trust.keystore import Keystore


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `certs` to the command line."""
    parser = subparsers.add_parser(
        "certs", help="issue, list and revoke certificates", description=__doc__
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    init = commands.add_parser("init", help="make the swarm's certificate authority")
    init.add_argument(
        "--again", action="store_true", help="a new one in its place: all certificates end"
    )
    init.set_defaults(run=_init)
    issue = commands.add_parser("issue", help="a new key and certificate for a role")
    issue.add_argument("name", metavar="NAME", help=RULE)
    issue.add_argument(
        "--address",
        action="append",
        default=[],
        metavar="HOST",
        help="one more name or IP address under which others reach it (the router; repeatable)",
    )
    issue.add_argument(
        "--again", action="store_true", help="also where it was revoked a short while ago"
    )
    issue.set_defaults(run=_issue)
    listed = commands.add_parser("list", help="who has one, and until when")
    listed.add_argument("--json", action="store_true", help="one object on standard output")
    listed.set_defaults(run=_list)
    revoke = commands.add_parser("revoke", help="take a role's rights away")
    revoke.add_argument("name", metavar="NAME", help="as `coadapt certs list` shows it")
    revoke.set_defaults(run=_revoke)
    for command in (init, issue, listed, revoke):
        add_swarm(command)


def _keystore(args: argparse.Namespace) -> Keystore:
    # Only here: every command reads this module, and the library takes its time.
    from deploy.trust.prepare import keystore_of

    state = read_state(check_name("swarm name", args.swarm))
    return keystore_of(state.spec.var_dir if state else str(var_dir_of(args.swarm)))


def _init(args: argparse.Namespace) -> int:
    if args.again and read_state(args.swarm) is not None:
        raise DeployError(
            f"swarm {args.swarm!r} runs with the authority that it has; "
            f"`{typed('down', args.swarm)}` first"
        )
    store = _keystore(args)
    made = store.init(args.swarm, again=args.again)
    print(f"{store.folder}: {'a new authority' if made else 'has an authority already'}")
    return 0


def _issue(args: argparse.Namespace) -> int:
    identity = _keystore(args).issue(args.name, args.address, again=args.again)
    print(f"{identity.folder}: of {args.name}")
    print(f"use         COADAPT_ROUTER=tls/HOST:PORT#identity={identity.folder}")
    return 0


def _list(args: argparse.Namespace) -> int:
    issued = _keystore(args).issued()
    if args.json:
        print(msgspec.json.encode({"certificates": issued}).decode())
        return 0
    now = datetime.now(UTC)
    rows = []
    for one in issued:
        hours = (one.end - now).total_seconds() / 3600
        told = "revoked" if one.revoked else f"{hours:.1f} h left" if hours > 0 else "over"
        rows.append((one.name, told, f"{one.end:%F %T} UTC", f"{one.serial:x}"))
    print("\n".join(columns([("name", "state", "until", "serial"), *rows])))
    return 0


def _revoke(args: argparse.Namespace) -> int:
    store = _keystore(args)
    store.revoke(args.name)
    print(
        f"{args.name} has no rights any more: the router takes the new rules within some seconds, "
        "and all who are connected come anew"
    )
    if role_of(args.name).kind == "robot":
        print(f"its ego     coadapt certs revoke ego-{args.name}, where it had one")
    print(f"back        coadapt certs issue {args.name} --again, where nobody has the old one")
    return 0
