"""`coadapt up`: start a swarm on this machine and wait until it works."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

from deploy import ready, runtimes
from deploy.docker.grafana import PASSWORD_FILE
from deploy.progress import say, typed
from deploy.rates import parse_link_rate
from deploy.runtime import Runtime
from deploy.services import journal_path
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import State, need_state, read_state
from swarm.errors import DeployError, not_installed
from worlds.registry import swarm_worlds, world_kind
from worlds.sample import is_checkout

if TYPE_CHECKING:
    from worlds.base import World

WAIT_S = 60.0
WAIT_S_A_ROBOT = 3.0
"""Importing Open3D takes seconds, and a small machine starts many robots at once."""

NEEDED = ("aiohttp", "docker", "jsonschema", "starlette", "uvicorn")
"""What the processes of a swarm import that a robot goes without."""


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `up` to the command line."""
    parser = subparsers.add_parser("up", help="start a swarm", description=__doc__)
    parser.add_argument("--swarm", default="local", help="name of the swarm (default: local)")
    parser.add_argument("--robots", type=int, default=6, help="how many (default: 6)")
    parser.add_argument("--world", choices=swarm_worlds(), default="factory")
    parser.add_argument(
        "--data",
        default="",
        help="recorded data: directory of opv2v (default: the sample that `coadapt data` brings) "
        "or bag, file of recording",
    )
    parser.add_argument("--runtime", choices=("auto", "docker", "netns"), default="auto")
    parser.add_argument(
        "--policy", help="how the ego decides (default: coverage; llm where --llm is given)"
    )
    parser.add_argument(
        "--llm",
        default="",
        metavar="WHERE",
        help="language models: embedded, or the URL of an OpenAI-compatible server",
    )
    parser.add_argument("--llm-model", default="", metavar="NAME", help="which model")
    parser.add_argument("--period", type=float, default=1.0, help="seconds between decisions")
    parser.add_argument("--q-min", type=float, default=0.7, help="least quality, 0 to 1")
    parser.add_argument("--rings", type=int, choices=(16, 32, 64), default=32, help="of the LiDARs")
    parser.add_argument("--scenario", default="floor", help="of the factory")
    parser.add_argument("--seed", type=int, default=1, help="of the factory")
    parser.add_argument("--ego", help="which robot fuses (default: the first)")
    parser.add_argument("--comm-range", type=float, metavar="M", help="metres around the ego")
    parser.add_argument("--link", metavar="RATE", help="shape the cell to the ego, like 55mbit")
    parser.add_argument("--no-prometheus", action="store_true", help="go without Prometheus")
    parser.add_argument("--prometheus-port", type=int, default=9090, help="on 127.0.0.1")
    parser.add_argument("--ego-metrics-port", type=int, default=9102, help="on 127.0.0.1")
    parser.add_argument("--router-port", type=int, default=7447, help="first of three")
    parser.add_argument("--qod-port", type=int, default=9104, help="on 127.0.0.1")
    parser.add_argument(
        "--controller-metrics-port", type=int, default=9103, help="on Docker's bridge, in Docker"
    )
    parser.add_argument("--llm-port", type=int, default=9106, help="on 127.0.0.1")
    parser.add_argument(
        "--gateway-metrics-port", type=int, default=9105, help="on Docker's bridge, in Docker"
    )
    parser.add_argument("--grafana", action="store_true", help="start Grafana, too (in Docker)")
    parser.add_argument("--grafana-port", type=int, default=3000, help="on 127.0.0.1")
    parser.add_argument("--no-console", action="store_true", help="go without the console")
    parser.add_argument("--console-port", type=int, default=8080, help="on 127.0.0.1")
    parser.add_argument(
        "--console-metrics-port", type=int, default=9107, help="on Docker's bridge, in Docker"
    )
    parser.add_argument("--wait", type=float, help="seconds to wait for the first decision")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Starts the swarm, unless it runs already; a swarm that does not start is removed again."""
    for package in NEEDED:
        if importlib.util.find_spec(package) is None:
            raise DeployError(not_installed(package))
    runtime, why = _runtime(args)
    say(why)
    spec = _spec(args, runtime)
    if not runtime.up(spec):
        say(f"swarm {spec.swarm!r} runs already")
        _print_where(need_state(spec.swarm))
        return 0
    wait_s = args.wait if args.wait is not None else WAIT_S + WAIT_S_A_ROBOT * len(spec.robots)
    try:
        state = need_state(spec.swarm)
        ready.wait_ready(runtime, state, wait_s)
    except BaseException:
        say("taking it down again ...")
        runtime.down(spec.swarm)
        raise
    _print_where(state)
    return 0


def _runtime(args: argparse.Namespace) -> tuple[Runtime, str]:
    state = read_state(args.swarm)
    if state is None:
        return runtimes.choose(args.runtime)
    if args.runtime not in ("auto", state.runtime):
        raise DeployError(
            f"swarm {args.swarm!r} already exists in runtime {state.runtime}; "
            f"run `{typed('down')}` first"
        )
    return runtimes.get(state.runtime), f"runtime {state.runtime}: the swarm already exists in it"


def _spec(args: argparse.Namespace, runtime: Runtime) -> SwarmSpec:
    robots = factory_robots(args.robots)
    comm_range_m, data = args.comm_range, args.data
    kind = world_kind(args.world)
    if kind.data:
        if not data and kind.sample:
            data = str(kind.sample())
        if not data:
            raise DeployError(
                f"world {kind.name} needs --data {kind.word}, {kind.needs} "
                f"({typed('up', world=kind.name, data=kind.word)})"
            )
        world = _recorded(args.world, Path(data))
        robots = world.robots[: args.robots]
        comm_range_m = comm_range_m or getattr(world, "comm_range_m", None)
        say(f"{data} has the robots {', '.join(robots)}")
    optional = {} if args.ego is None else {"ego": args.ego}
    return make_spec(
        swarm=args.swarm,
        runtime=runtime.name,
        robots=robots,
        world=args.world,
        data=str(Path(data).absolute()) if data else "",
        seed=args.seed,
        rings=args.rings,
        scenario=args.scenario,
        policy=args.policy or ("llm" if args.llm else "coverage"),
        llm=args.llm,
        llm_model=args.llm_model,
        llm_port=args.llm_port,
        gateway_metrics_port=args.gateway_metrics_port,
        period_s=args.period,
        q_min=args.q_min,
        prometheus=not args.no_prometheus,
        prometheus_port=args.prometheus_port,
        ego_metrics_port=args.ego_metrics_port,
        router_port=args.router_port,
        qod_port=args.qod_port,
        controller_metrics_port=args.controller_metrics_port,
        grafana=args.grafana,
        grafana_port=args.grafana_port,
        console=not args.no_console,
        console_port=args.console_port,
        console_metrics_port=args.console_metrics_port,
        comm_range_m=comm_range_m,
        link_bps=parse_link_rate(args.link) if args.link else None,
        **optional,
    )


def _recorded(name: str, data: Path) -> World:
    # Imported here: the other commands need no arrays.
    from worlds.registry import open_world

    world = open_world(name, data=data)
    for note in getattr(world, "notes", ()):
        say(note)
    return world


def _print_where(state: State) -> None:
    spec = state.spec
    print(f"swarm       {spec.swarm} ({state.runtime}): {len(spec.robots)} robots, ego {spec.ego}")
    print(f"console     {state.console_url or 'none'}")
    print(f"prometheus  {state.prometheus_url or 'none'}")
    if state.grafana_url:
        print(f"grafana     {state.grafana_url} (admin's password: {spec.run_dir}/{PASSWORD_FILE})")
    print(f"ego metrics {state.ego_metrics_url}")
    print(f"qod api     {state.qod_url}/quality-on-demand/v1")
    if state.llm_url:
        print(f"llm gateway {state.llm_url}/v1 ({spec.llm})")
    print(f"router      {state.router}")
    print(f"journal     {journal_path(spec, spec.var_dir)}")
    if is_checkout():
        print("next        make status, make shape RATE=5mbit, make logs, make metrics, make down")
    else:
        print("next        coadapt status, coadapt net shape --rate 5mbit, coadapt down")
