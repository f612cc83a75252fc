"""What commands share that write a swarm down for machines of a cluster."""

from __future__ import annotations

import argparse
import getpass
import os
from typing import get_args

from deploy.cluster import plan
from deploy.cluster.plan import Cluster, Network
from deploy.progress import say
from deploy.spec import PORT_FIELDS, PROPERTIES, SwarmSpec, var_dir_of
from swarm.errors import DeployError
from swarm.trust.roles import operator_of


def add_cluster(parser: argparse.ArgumentParser, networks: str, router: str = "") -> None:
    """Adds the options about the machines. `networks`: what the choices of
    --network mean; `router`: its address where that goes without saying."""
    parser.add_argument(
        "--image",
        default=os.environ.get(plan.IMAGE, ""),
        help=f"the swarm's image in a registry, {plan.IMAGE_RULE} (default: {plan.IMAGE})",
    )
    parser.add_argument(
        "--llm-image", default="", metavar="IMAGE", help="that of --llm embedded, with its model"
    )
    parser.add_argument(
        "--router",
        default=router,
        required=not router,
        metavar="HOST",
        help="name or address at which every machine reaches the router"
        + (f" (default: {router})" if router else ""),
    )
    parser.add_argument(
        "--metrics-tls",
        action="store_true",
        help="serve metrics over TLS, with the processes' certificates",
    )
    parser.add_argument(
        "--interface",
        default="",
        metavar="NAME",
        help="each robot's node has a network controller, which shapes this interface of it, as "
        "root (default: no link is shaped)",
    )
    parser.add_argument(
        "--default-route",
        action="store_true",
        help="the interface may be the one of the default route",
    )
    parser.add_argument("--network", choices=get_args(Network), default=plan.NETWORK, help=networks)


def chosen_cluster(args: argparse.Namespace) -> Cluster:
    """Raises DeployError that names an option and what it may be."""
    return plan.make_cluster(
        args.image,
        args.router,
        args.network,
        args.llm_image,
        args.interface,
        default_route=args.default_route,
    )


def settled(args: argparse.Namespace) -> dict[str, object]:
    """What of a swarm holds on a cluster whatever the roster's options say: it is secure, its ports
    are the usual ones, and its time began with its authority. Raises DeployError, IdentityError."""
    # Only here: every command reads this module, and the library takes its time.
    from deploy.trust.prepare import begun

    if args.link and not args.interface:
        raise DeployError(
            "--link shapes the link of the ego's node: name the interface that leads there, by "
            "--interface"
        )
    if args.listen:
        raise DeployError(
            "--listen is for machines that join one machine's swarm; a cluster's router answers at "
            "--router"
        )
    ports = {name: PROPERTIES[name].default for name in PORT_FIELDS if getattr(args, name) is None}
    var_dir = str(var_dir_of(args.swarm))
    return {**ports, "secure": True, "epoch_ns": begun(var_dir, args.swarm)}


def certify(spec: SwarmSpec, cluster: Cluster) -> None:
    """Issues what certificates the processes lack, and whoever types this. Raises DeployError, and
    IdentityError."""
    from deploy.trust.prepare import keep

    names = [*plan.roles(spec, cluster), operator_of(getpass.getuser()).common_name]
    addresses = plan.router_addresses(cluster)
    issued = keep(spec, plan.place_of(spec, cluster), names, addresses)
    if issued:
        say(f"new certificates for {', '.join(issued)}: what runs with an older one starts anew")
