"""`coadapt down`: end a swarm and leave nothing of it behind but its journals and logs."""

from __future__ import annotations

import argparse

from coadapt.arguments import add_swarm
from deploy import runtimes
from deploy.state import read_state
from swarm.errors import DeployError


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `down` to the command line."""
    parser = subparsers.add_parser("down", help="stop a swarm", description=__doc__)
    add_swarm(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Ends the swarm; nothing to end is no error."""
    try:
        state = read_state(args.swarm)
    except DeployError:
        state = None  # The record is broken: what it would say is found out below.
    if state is not None:
        found = runtimes.get(state.runtime).down(args.swarm)
    else:
        # Without a record, say after a crash, either runtime may have left something.
        found = runtimes.get("netns").down(args.swarm)
        docker = runtimes.get("docker")
        if docker.available() is None:
            found = docker.down(args.swarm) or found
    print(f"swarm {args.swarm!r} is down" if found else f"no swarm {args.swarm!r} was running")
    return 0
