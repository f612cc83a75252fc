"""`coadapt up`: start a swarm on this machine and wait until it works."""

from __future__ import annotations

import argparse
import importlib.util
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args, get_origin

from msgspec.structs import replace

from coadapt.arguments import comma_separated
from coadapt.choices import check_choices
from coadapt.site import bring_site
from coadapt.world_choice import chosen_kind, open_chosen
from deploy import ready, runtimes
from deploy.docker.grafana import PASSWORD_FILE
from deploy.paths import KEYSTORE, journal_path
from deploy.ports import based_on, with_free_ports
from deploy.progress import say, typed
from deploy.rates import parse_link_rate
from deploy.room import check_room
from deploy.runtime import Runtime
from deploy.spec import (
    MAX_ROBOTS,
    MIN_ROBOTS,
    PORT_FIELDS,
    PROPERTIES,
    SwarmSpec,
    factory_robots,
    make_spec,
)
from deploy.state import State, need_state, read_state
from swarm.defaults import POLICY
from swarm.errors import DeployError, PropertyError, SettingError, not_installed
from swarm.process import ProcessSettings
from worlds.kinds import WorldRequest
from worlds.registry import data_words, swarm_worlds

WAIT_S = 60.0
WAIT_S_A_ROBOT = 3.0
"""Importing Open3D takes seconds, and a small machine starts many robots at once."""
WAIT_S_AN_EGO = 6.0
"""Each beyond the first loads its networks, too."""
ALL = "all"

HERE = "on 127.0.0.1"
ON_BRIDGE = "on Docker's bridge, in Docker"
PORT = "default: {}, or the next free one"
OPTIONS = {
    "--swarm": ("swarm", "name of the swarm"),
    "--world": ("world", "where the robots are"),
    "--data": (
        "data",
        f"recorded data ({data_words()}); opv2v without it takes the sample that `coadapt data` "
        "brings",
    ),
    "--llm": ("llm", "language models: embedded, or the URL of an OpenAI-compatible server"),
    "--llm-model": ("llm_model", "which model"),
    "--cell": ("cell", "of several egos: each has its own, or all share one medium"),
    "--listen": (
        "listen",
        "IPv4 address of this machine at which robots and tools elsewhere reach the router; secure",
    ),
    "--period": ("period_s", "seconds between decisions"),
    "--q-min": ("q_min", "least quality, 0 to 1"),
    "--rings": ("rings", "of the LiDARs"),
    "--pose-error": (
        "pose_error_m",
        "by how much robots err about where they are, metres and degrees (standard deviation)",
    ),
    "--scenario": ("scenario", "of the factory"),
    "--seed": ("seed", "of the factory"),
    "--router-port": ("router_port", "first of three"),
    "--prometheus-port": ("prometheus_port", HERE),
    "--ego-metrics-port": ("ego_metrics_port", HERE),
    "--qod-port": ("qod_port", HERE),
    "--controller-metrics-port": ("controller_metrics_port", ON_BRIDGE),
    "--llm-port": ("llm_port", HERE),
    "--gateway-metrics-port": ("gateway_metrics_port", ON_BRIDGE),
    "--grafana-port": ("grafana_port", HERE),
    "--console-port": ("console_port", HERE),
    "--console-metrics-port": ("console_metrics_port", ON_BRIDGE),
}
"""Options for properties of a swarm, which say type, choices and default."""

_OPTION_OF = {name: option for option, (name, _) in OPTIONS.items()} | {
    "robots": "--robots",
    "comm_range_m": "--comm-range",
    "egos": "--egos",
    "ego_standby": "--ego-standby",
    "link_bps": "--link",
    "world_robots": "--world-robots",
}
"""How a property is named on the command line, where the words are not the same."""

_PROCESS = ProcessSettings()
NEEDED = ("aiohttp", "docker", "jsonschema", "starlette", "uvicorn")
"""What the processes of a swarm import that a robot goes without."""


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `up` to the command line."""
    parser = subparsers.add_parser("up", help="start a swarm", description=__doc__)
    add_roster(parser)
    parser.add_argument("--runtime", choices=("auto", *runtimes.names()), default="auto")
    parser.add_argument("--grafana", action="store_true", help="start Grafana, too (in Docker)")
    parser.add_argument(
        "--secure",
        action=argparse.BooleanOptionalAction,
        help="every process shows a certificate, and may do only its part (default: in Docker)",
    )
    parser.add_argument(
        "--metrics-tls",
        action="store_true",
        help="serve metrics over TLS, with the processes' certificates",
    )
    parser.add_argument(
        "--port-base",
        type=int,
        metavar="PORT",
        help="take the ports from this one on (default: the usual ones, or the next free ones)",
    )
    parser.add_argument("--wait", type=float, help="seconds to wait for the first decision")
    parser.set_defaults(run=run)


def add_roster(parser: argparse.ArgumentParser) -> None:
    """Options that say what a swarm consists of, wherever it runs."""
    parser.add_argument(
        "--robots",
        type=int,
        help=f"how many (default: {_PROCESS.world_robots}; of data, no more than there are)",
    )
    parser.add_argument(
        "--world-robots",
        type=int,
        metavar="N",
        help="for how many a simulated world has room; others may join (default: --robots)",
    )
    parser.add_argument(
        "--policy", help=f"how the ego decides (default: {POLICY}; llm where --llm is given)"
    )
    parser.add_argument("--ego", help="which robot fuses (default: the first)")
    parser.add_argument(
        "--egos",
        metavar="ROBOTS",
        help=f"which robots fuse, each for itself: ids with commas between, or {ALL}",
    )
    parser.add_argument(
        "--ego-standby", metavar="ROBOT", help="which robot fuses while the ego is away"
    )
    parser.add_argument(
        "--comm-range", dest="comm_range_m", type=float, metavar="M", help="metres around the ego"
    )
    parser.add_argument("--link", metavar="RATE", help="shape the cell to the ego, like 55mbit")
    for name, what in (("prometheus", "Prometheus"), ("console", "the console")):
        parser.add_argument(
            f"--no-{name}", dest=name, action="store_false", help=f"go without {what}"
        )
    for option, (name, words) in OPTIONS.items():
        field = PROPERTIES[name]
        if name in PORT_FIELDS:
            told = f"{words} ({PORT.format(field.default)})"
            parser.add_argument(option, dest=name, type=int, metavar="PORT", help=told)
            continue
        choices = get_args(field.type) if get_origin(field.type) is Literal else None
        parser.add_argument(
            option,
            dest=name,
            type=type(field.default),
            default=None if name == "world" else field.default,
            choices=swarm_worlds() if name == "world" else choices,
            metavar=None if choices or name == "world" else option.lstrip("-").upper(),
            help=f"{words} (default: {_usual(name)})" if field.default else words,
        )


def _usual(name: str) -> str:
    """What holds where a property is not given."""
    usual = str(PROPERTIES[name].default)
    return f"the one that --data is of, else {usual}" if name == "world" else usual


def run(args: argparse.Namespace) -> int:
    """Starts the swarm, unless it runs already; a swarm that does not start is removed again."""
    for package in NEEDED:
        if importlib.util.find_spec(package) is None:
            raise DeployError(not_installed(package))
    running = read_state(args.swarm)
    runtime, why = _runtime(args, running)
    say(why)
    spec = _spec(args, runtime, running)
    with _ended_politely():
        return _up(args, runtime, spec)


def _up(args: argparse.Namespace, runtime: Runtime, spec: SwarmSpec) -> int:
    if not runtime.up(spec):
        say(f"swarm {spec.swarm!r} runs already")
        _print_where(need_state(spec.swarm))
        return 0
    usual_s = WAIT_S + WAIT_S_A_ROBOT * len(spec.robots) + WAIT_S_AN_EGO * len(spec.egos)
    wait_s = args.wait if args.wait is not None else usual_s
    try:
        state = need_state(spec.swarm)
        ready.wait_ready(runtime, state, wait_s)
    except BaseException:
        say("taking it down again ...")
        runtime.down(spec.swarm)
        raise
    _bring_site(spec)
    _print_where(state)
    return 0


def _bring_site(spec: SwarmSpec) -> None:
    """Writes down how the site's places are called; a swarm runs without, too."""
    try:
        aside = bring_site(spec)
    except (OSError, SettingError) as error:
        say(f"the site file is not written: {error}")
        return
    if aside is not None:
        say(f"the floor is another one; the places that were drawn before are in {aside}")


@contextmanager
def _ended_politely() -> Iterator[None]:
    """SIGTERM ends a start as Ctrl-C does: what has been started goes again."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _runtime(args: argparse.Namespace, state: State | None) -> tuple[Runtime, str]:
    if state is None:
        return runtimes.choose(args.runtime)
    if args.runtime not in ("auto", state.runtime):
        raise DeployError(
            f"swarm {args.swarm!r} already exists in runtime {state.runtime}; "
            f"run `{typed('down', args.swarm)}` first"
        )
    return runtimes.get(state.runtime), f"runtime {state.runtime}: the swarm already exists in it"


def _spec(args: argparse.Namespace, runtime: Runtime, running: State | None) -> SwarmSpec:
    """The swarm that is wished for. Raises DeployError that names an option and what it may be."""
    try:
        spec = _wished(args, runtime.name)
        if running is None:
            check_room(len(spec.robots))
        named = {name for name in PORT_FIELDS if getattr(args, name) is not None}
        if args.port_base is not None:
            based = based_on(args.port_base)
            spec = replace(spec, **{n: port for n, port in based.items() if n not in named})
            if running is None and (taken := with_free_ports(spec, named)[1]):
                raise DeployError(f"--port-base {args.port_base} is not free: {taken[0]}")
            named = set(PORT_FIELDS)
    except PropertyError as error:
        raise _by_option(error) from error
    check_choices(spec)
    if running is not None:
        kept = {n: getattr(running.spec, n) for n in PORT_FIELDS if n not in named}
        return replace(spec, **kept)
    spec, changes = with_free_ports(spec, named)
    for change in changes:
        say(change)
    return spec


def wished(args: argparse.Namespace, runtime: str, **more: object) -> SwarmSpec:
    """The swarm that the options of `add_roster` describe, for what runs it, with more properties.

    Raises DeployError that names an option and what it may be, and what `check_choices` raises."""
    try:
        spec = _wished(args, runtime, **more)
    except PropertyError as error:
        raise _by_option(error) from error
    check_choices(spec)
    return spec


def _by_option(error: PropertyError) -> DeployError:
    option = _OPTION_OF.get(error.name, f"--{error.name}")
    return DeployError(f"{option} {error.value} is not valid; it must be {error.rule}")


def _wished(args: argparse.Namespace, runtime: str, **more: object) -> SwarmSpec:
    count = _PROCESS.world_robots if args.robots is None else args.robots
    if not MIN_ROBOTS <= count <= MAX_ROBOTS:
        raise PropertyError("robots", count, str(count), f"{MIN_ROBOTS} to {MAX_ROBOTS}")
    robots = factory_robots(count)
    data = args.data
    kind = chosen_kind(args.world, data, _PROCESS.world)
    if kind.data:
        if not data and kind.sample:
            data = str(kind.sample())
        if not data:
            raise DeployError(
                f"world {kind.name} needs --data {kind.word}, {kind.needs} "
                f"({typed('up', world=kind.name, data=kind.word)})"
            )
    comm_range_m = args.comm_range_m
    if not kind.numbered:
        request = WorldRequest(
            data=data, robots=count, seed=args.seed, rings=args.rings, scenario=args.scenario
        )
        robots, usual_range_m = open_chosen(kind, request)
        if args.robots is not None and count > len(robots):
            say(f"--robots {count}: there are no more than {len(robots)}")
        comm_range_m = comm_range_m or usual_range_m
    values = {
        name: value
        for name, value in vars(args).items()
        if name in PROPERTIES and not (value is None and name in (*PORT_FIELDS, "secure"))
    }
    values |= {
        "runtime": runtime,
        "world": kind.name,
        "robots": robots,
        "data": str(Path(data).absolute()) if data else "",
        "policy": args.policy or ("llm" if args.llm else POLICY),
        "comm_range_m": comm_range_m,
        "egos": robots if args.egos == ALL else tuple(comma_separated(args.egos or "")),
        "link_bps": parse_link_rate(args.link) if args.link else None,
    }
    if args.ego is None:
        del values["ego"]
    return make_spec(**values | more)


def _print_where(state: State) -> None:
    spec = state.spec
    print(f"swarm       {spec.swarm} ({state.runtime}): {len(spec.robots)} robots, ego {spec.ego}")
    if spec.egos:
        print(f"egos        {', '.join(spec.egos)} decide each for itself")
    if spec.ego_standby:
        print(f"standby     {spec.ego_standby} decides while the ego of {spec.ego} is away")
    print(f"console     {state.console_url or 'none'}")
    print(f"prometheus  {state.prometheus_url or 'none'}")
    if state.grafana_url:
        print(f"grafana     {state.grafana_url} (admin's password: {spec.run_dir}/{PASSWORD_FILE})")
    print(f"ego metrics {state.ego_metrics_url}")
    print(f"qod api     {state.qod_url}/quality-on-demand/v1")
    if state.llm_url:
        print(f"llm gateway {state.llm_url}/v1 ({spec.llm})")
    print(f"router      {state.router}")
    if spec.listen:
        place = f"{'tls' if spec.secure else 'tcp'}/{spec.listen}:{spec.router_port}"
        join = f"coadapt join {place} --robot NAME{' --cert FOLDER' if spec.secure else ''}"
        print(f"join        {join}")
    if spec.secure:
        print(f"keystore    {spec.var_dir}/{KEYSTORE} (`coadapt certs list --swarm {spec.swarm}`)")
    print(f"journal     {journal_path(spec, spec.var_dir)}")
    steps: tuple[tuple[str, dict[str, object]], ...] = (
        ("status", {}),
        ("shape", {"rate": "5mbit"}),
        ("logs", {}),
        ("metrics", {}),
        ("down", {}),
    )
    commands = (typed(command, spec.swarm, **options) for command, options in steps)
    print(f"next        {', '.join(commands)}")
