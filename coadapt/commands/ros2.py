"""`coadapt ros2`: publish what an ego found as ROS 2 topics, over rmw_zenoh's router."""

from __future__ import annotations

import argparse

from coadapt.arguments import add_ego, add_swarm
from coadapt.elsewhere import add_router, state_of
from deploy.progress import say
from swarm.process import stop_on_signals


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `ros2` to the command line."""
    parser = subparsers.add_parser(
        "ros2",
        help="publish fused objects as ROS 2 topics",
        description="Publishes what an ego found together with its participants as ROS 2 topics, "
        "over the Zenoh router of rmw_zenoh, until Ctrl-C or the swarm is gone: "
        "PREFIX/objects (vision_msgs/Detection3DArray), PREFIX/markers "
        "(visualization_msgs/MarkerArray) and PREFIX/unseen (nav_msgs/OccupancyGrid).",
    )
    parser.add_argument(
        "target",
        metavar="ADDRESS",
        help="where ROS is: ros2://HOST[:PORT]/DOMAIN[?prefix=/NAME][&hashes=no] (port 7447, "
        "domain 0 and /coadapt by default; hashes=no for ROS 2 Humble)",
    )
    add_ego(parser)
    add_swarm(parser)
    add_router(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Publishes until it is stopped. Raises SettingError for an address that cannot be one."""
    from options.ros2.output import parse_target
    from options.ros2.telling import tell

    target = parse_target(args.target)
    state = state_of(args)
    stop = stop_on_signals()
    told = tell(state.router, state.spec.swarm, state.spec.ego, target, stop, say)
    lost = f"; {told.lost} of the swarm's were lost" if told.lost else ""
    say(f"ended: {told.ended}")
    print(f"{told.messages} messages published{lost}")
    return 0
