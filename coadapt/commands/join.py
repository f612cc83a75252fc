"""`coadapt join`: run a robot on this machine, in a swarm whose router is on another one."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import threading
from pathlib import Path

from coadapt.joining import (
    CALM,
    Wish,
    folder_of,
    learn,
    needs_ego,
    router_of,
    settings_of,
    swarm_of,
)
from coadapt.systemd import print_unit
from deploy.progress import say
from swarm.errors import CoAdaptError, SettingError
from swarm.keyspace import check_name
from swarm.process import leave, stop_on_signals
from swarm.trust.identity import KEY

PROCESS = "robot_agent.__main__"
DETECTOR = "perception.detector.learned"


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `join` to the command line."""
    parser = subparsers.add_parser("join", help="run a robot on this machine", description=__doc__)
    parser.add_argument(
        "router",
        metavar="ROUTER",
        help="tls/HOST[:PORT], or tcp/HOST[:PORT] of a plain swarm; scout: find it by multicast",
    )
    parser.add_argument("--robot", required=True, help="which robot this is, like R7")
    parser.add_argument(
        "--cert",
        type=Path,
        metavar="FOLDER",
        help="its certificate and key, from `coadapt certs issue` where the swarm runs",
    )
    parser.add_argument(
        "--swarm", help="name of the swarm (default: the certificate's; of a plain one, local)"
    )
    world = parser.add_argument_group("world", "what is not given, the ego tells")
    world.add_argument("--world", help="where the robot's scans come from: `coadapt worlds`")
    world.add_argument("--data", metavar="PATH", help="recorded data, or a live robot's address")
    world.add_argument("--world-robots", type=int, metavar="N", help="of a simulated world")
    world.add_argument("--seed", type=int, help="of a simulated world")
    world.add_argument("--scenario", help="of the factory")
    world.add_argument("--epoch", type=int, metavar="NS", help="when frame 0 was captured")
    world.add_argument("--rings", type=int, help="of this robot's LiDAR in the factory")
    world.add_argument("--cache", metavar="FOLDER", help="keeps simulated or parsed scans")
    parser.add_argument(
        "--metrics", metavar="HOST:PORT", help="serve metrics there (default: 127.0.0.1:9101)"
    )
    parser.add_argument(
        "--systemd", action="store_true", help="print a unit that does this at every boot, and end"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="of --systemd: write it there instead"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Runs the robot once its settings are known and checked."""
    if args.output and not args.systemd:
        raise SettingError("--output goes with --systemd only")
    wish = _wish(args)
    router = router_of(wish)
    swarm = swarm_of(router, args.swarm)
    if args.systemd:
        _write_unit(args, wish, swarm)
        return 0
    say(f"robot {wish.robot} joins swarm {swarm!r} at {router.partition('#')[0]}; Ctrl-C ends it")
    for name, value in CALM.items():
        os.environ.setdefault(name, value)
    stop = stop_on_signals()
    try:
        leave(_become(wish, router, swarm, stop))
    except CoAdaptError as error:
        # At once, as all that ends here: other threads are in the middle of their work.
        print(f"coadapt: {error}", file=sys.stderr)
        leave(0 if stop.is_set() else 1)


def _become(wish: Wish, router: str, swarm: str, stop: threading.Event) -> int:
    """Runs the robot in the world that is typed or learnt. Raises CoAdaptError."""
    # What the robot is made of takes as long to load as the ego takes to say a word.
    loading = threading.Thread(target=_load, daemon=True)
    loading.start()
    learnt: dict[str, object] = {}
    if needs_ego(wish.given()):
        learnt = learn(router, swarm, stop)
        say(f"the ego's world: {' '.join(f'{name}={value}' for name, value in learnt.items())}")
    settings = settings_of(wish, router, swarm, learnt, os.environ)
    loading.join()
    return int(importlib.import_module(PROCESS).serve(lambda: settings, stop))


def _load() -> None:
    for name in (PROCESS, DETECTOR):
        importlib.import_module(name)


def _wish(args: argparse.Namespace) -> Wish:
    host, _, port = (args.metrics or "127.0.0.1:9101").rpartition(":")
    return Wish(
        place=args.router,
        robot=check_name("robot id", args.robot),
        cert=args.cert,
        swarm=args.swarm,
        settings={
            "world": args.world,
            "world_data": str(Path(args.data).absolute()) if _is_path(args) else args.data,
            "world_robots": args.world_robots,
            "world_seed": args.seed,
            "world_scenario": args.scenario,
            "world_rings": args.rings,
            "world_cache": str(Path(args.cache).absolute()) if args.cache else None,
            "epoch_ns": args.epoch,
            "metrics_host": host,
            "metrics_port": port,
        },
    )


def _is_path(args: argparse.Namespace) -> bool:
    """Whether --data names what lies on this machine; a live robot's address stays as it is."""
    return bool(args.data) and Path(args.data).exists()


def _write_unit(args: argparse.Namespace, wish: Wish, swarm: str) -> None:
    words = [wish.place, "--robot", wish.robot, "--swarm", swarm]
    if wish.cert is not None:
        words += ["--cert", str(wish.cert.expanduser().absolute())]
    if args.metrics:
        words += ["--metrics", args.metrics]
    options = {
        "world": "--world",
        "world_data": "--data",
        "world_robots": "--world-robots",
        "world_seed": "--seed",
        "world_scenario": "--scenario",
        "world_rings": "--rings",
        "world_cache": "--cache",
        "epoch_ns": "--epoch",
    }
    for name, value in wish.given().items():
        if name in options:
            words += [options[name], str(value)]
    what = f"robot {wish.robot} of swarm {swarm}"
    cache = str(wish.settings["world_cache"] or "")
    key = folder_of(wish.cert, wish.robot) / KEY if wish.cert is not None else None
    print_unit(what, ["coadapt.main", "join", *words], key, cache, args.output)
