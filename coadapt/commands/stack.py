"""`coadapt stack`: a swarm on many machines, as a stack of Docker Swarm.

coadapt stack --image HOST:5000/coadapt-edge:1 --router 10.0.0.1 |
    docker stack deploy -c - coadapt
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

from coadapt.arguments import comma_separated
from coadapt.cluster_choice import add_cluster, certify, chosen_cluster, settled
from coadapt.commands.up import add_roster, wished
from deploy.cluster import nodes, stack
from deploy.progress import say
from swarm.errors import DeployError


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `stack` to the command line."""
    parser = subparsers.add_parser(
        "stack",
        help="write a swarm down as a stack of Docker Swarm",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_roster(parser)
    add_cluster(
        parser,
        "host: the nodes' own network, which keeps packets' marks; overlay: one of Docker's "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--pin",
        choices=("label", "name"),
        default="label",
        help=f"a node is robot R3 by its label {stack.ROBOT_LABEL}=R3, or by its host name R3 "
        "(default: label)",
    )
    parser.add_argument(
        "--mesh",
        action="store_true",
        help="each robot's node has a router of its own, linked with all others: what two robots "
        "send each other passes no third node, and a node that is cut off goes on with what it has",
    )
    parser.add_argument(
        "--only",
        type=comma_separated,
        default=(),
        metavar="NAMES",
        help="only these processes, with commas between: the others stay as they are",
    )
    parser.add_argument(
        "--list", action="store_true", help="print the processes' names, and nothing else"
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="ask the engine whether each robot has a node, and whether what is deployed runs",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the stack file, after issuing what certificates it needs."""
    cluster = chosen_cluster(args)
    spec = wished(args, "swarm", **settled(args))
    if args.mesh:
        if cluster.network != "host":
            raise DeployError(f"--mesh needs --network host, not {cluster.network}")
        # Without these it cannot be said which routers there are.
        if args.check:
            _tell(nodes.problems(spec, (), args.pin))
        cluster = replace(cluster, hosts=nodes.hosts(spec, args.pin))
    certify(spec, cluster)
    if args.list:
        print("\n".join(stack.names(spec, cluster)))
        return 0
    if args.check:
        _tell(nodes.problems(spec, stack.names(spec, cluster), args.pin))
        print("every robot has a node, and what is deployed runs")
        return 0
    if told := stack.loses(cluster):
        say(told)
    prometheus = ""
    if spec.prometheus:
        known = nodes.addresses(spec, args.pin) if cluster.network == "host" else {}
        prometheus = stack.prometheus_file(spec, cluster, known)
        path = stack.config_path(spec)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(prometheus)
    print(stack.stack_file(spec, cluster, args.pin, args.only, prometheus), end="")
    return 0


def _tell(problems: Sequence[str]) -> None:
    if problems:
        raise DeployError("\n  ".join([f"{len(problems)} things are amiss:", *problems]))
