"""`coadapt kubernetes`: a swarm on many machines, as objects of Kubernetes.

coadapt kubernetes --image HOST:5000/coadapt-edge:1 --secrets | kubectl apply -n coadapt -f -
coadapt kubernetes --image HOST:5000/coadapt-edge:1 | kubectl apply -n coadapt -f -
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from coadapt.cluster_choice import add_cluster, certify, chosen_cluster, settled
from coadapt.commands.up import add_roster, wished
from deploy.cluster import charts, kubernetes, site
from swarm.version import installed_version


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `kubernetes` to the command line."""
    parser = subparsers.add_parser(
        "kubernetes",
        help="write a swarm down as objects of Kubernetes",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_roster(parser)
    add_cluster(
        parser,
        "host: robots, egos and router in the nodes' own network, which keeps packets' marks; "
        "overlay: in the cluster's (default: %(default)s)",
        router=site.ROUTER,
    )
    parser.add_argument(
        "--mesh",
        action="store_true",
        help="each robot's node has a router of its own, linked with all others; the site's is on "
        "a node of no robot",
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"write a kustomize base (DIR/{charts.BASE}) and a Helm chart (DIR/{charts.CHART}) "
        "instead of printing the objects",
    )
    parser.add_argument(
        "--secrets",
        action="store_true",
        help="print the Secrets, with certificates and keys in them, and nothing else",
    )
    parser.add_argument(
        "--monitoring",
        default=site.MONITORING,
        metavar="NAMESPACE",
        help="where Prometheus and its operator are (default: %(default)s)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints or writes the objects, after issuing what certificates they need."""
    cluster = chosen_cluster(args)
    monitoring = args.monitoring if args.prometheus else ""
    args.prometheus = False  # The cluster has one.
    spec = wished(args, "kubernetes", **settled(args))
    if args.mesh:
        cluster = replace(cluster, hosts=kubernetes.own_routers(spec))
    certify(spec, cluster)
    if args.secrets:
        print(charts.documents(kubernetes.secrets(spec, cluster)), end="")
        return 0
    if args.output:
        version = installed_version() or "0"
        for folder in charts.write(args.output, spec, cluster, monitoring, version):
            print(folder)
        return 0
    files = kubernetes.objects(spec, cluster, monitoring)
    print(charts.documents([one for own in files.values() for one in own]), end="")
    return 0
