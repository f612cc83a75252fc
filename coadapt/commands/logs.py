"""`coadapt logs`: what the processes of a running swarm have logged."""

from __future__ import annotations

import argparse
from collections import deque

from coadapt.arguments import add_swarm
from deploy import runtimes
from deploy.state import need_state

LINES_EACH = 5


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `logs` to the command line."""
    parser = subparsers.add_parser("logs", help="show logs", description=__doc__)
    parser.add_argument(
        "service", nargs="?", help="such as ego-R1 or router; without, the last lines of each"
    )
    parser.add_argument("--follow", "-f", action="store_true", help="go on with what comes")
    add_swarm(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints one log, or the end of each; following without a name follows the ego's."""
    state = need_state(args.swarm)
    runtime = runtimes.get(state.runtime)
    service = args.service or (f"ego-{state.spec.ego}" if args.follow else None)
    if service is not None:
        for line in runtime.logs(args.swarm, service, args.follow):
            print(line, flush=args.follow)
        return 0
    for process in runtime.status(args.swarm):
        print(f"== {process.service}: {process.state}, {process.restarts} restarts")
        for line in deque(runtime.logs(args.swarm, process.service, False), maxlen=LINES_EACH):
            print(line)
    return 0
