"""A swarm on another machine, known by its router alone: what the commands need of its record."""

from __future__ import annotations

import argparse
import re
import threading
from pathlib import Path

from coadapt.joining import swarm_of
from deploy.spec import SwarmSpec, var_dir_of
from deploy.state import State, need_state, seen_by
from swarm import zenoh_config
from swarm.defaults import SWARM
from swarm.errors import DeployError, SettingError, TransportError
from swarm.fitting import KIND, read_mark
from swarm.listening import listen
from swarm.messages import NetDemand
from swarm.trust.roles import role_of

ELSEWHERE = "elsewhere"
"""The runtime of a swarm that this machine did not start."""
CONNECT_S = 5.0
EGO_S = 6.0
"""An ego speaks in every cycle, every five seconds in the paper."""
_ROUTER = re.compile(
    r"(?P<place>(tcp|tls)/(\[[^\]]+\]|[^:/\s#]+)(:\d+)?)(#identity=(?P<folder>.+))?"
)


def add_router(parser: argparse.ArgumentParser) -> None:
    """Adds --router, by which a command finds a swarm on another machine."""
    parser.add_argument(
        "--router",
        metavar="ROUTER",
        help="of a swarm on another machine: tls/HOST[:PORT]#identity=FOLDER, with the certificate "
        "of an operator-NAME or reader-NAME; or tcp/HOST[:PORT]",
    )


def state_of(args: argparse.Namespace) -> State:
    """The record of the swarm that is meant: this machine's, or with --router what it tells itself;
    as it is for the ego that is meant, by default the first.

    Raises DeployError when no such swarm runs, or no ego is heard in it, and CoAdaptError for a
    router that cannot be one or a certificate that cannot be shown.
    """
    ego: str | None = getattr(args, "ego", None)
    if getattr(args, "router", None) is None:
        return seen_by(need_state(args.swarm), ego)
    router = router_of(args.router)
    # The default says nothing: the certificate's swarm is meant then.
    swarm = swarm_of(router, None if args.swarm == SWARM else args.swarm)
    return _met(router, swarm, ego)


def router_of(text: str) -> str:
    """The router's address as a client takes it, its certificate checked.

    Raises SettingError for a malformed address or a role that cannot use the tools, IdentityError
    for a certificate that cannot be shown.
    """
    found = _ROUTER.fullmatch(text)
    if found is None:
        raise SettingError(
            f"--router {text!r} is not valid; it must be tls/HOST[:PORT]#identity=FOLDER or "
            "tcp/HOST[:PORT]"
        )
    router = zenoh_config.with_port(found["place"])
    if found["folder"] is None:
        zenoh_config.client_config(router)
        return router
    folder = Path(found["folder"]).expanduser().absolute()
    if role_of(folder.name).kind not in ("operator", "reader", "console"):
        raise SettingError(
            f"--router {text}: {folder.name} may not do what this command does; "
            "`coadapt certs issue operator-NAME` makes a certificate that may, and reader-NAME one "
            "that may only look"
        )
    router += f"#identity={folder}"
    zenoh_config.check_router(router, folder.name)
    return router


def _met(router: str, swarm: str, ego: str | None) -> State:
    """What the ego, or the first that is heard, and the robots that are there tell of the swarm."""
    words: dict[str, NetDemand] = {}
    came = threading.Event()

    def on_demand(demand: NetDemand) -> None:
        words.setdefault(demand.ego, demand)
        if ego in (None, demand.ego):
            came.set()

    place = router.partition("#")[0]
    try:
        session = listen(router, swarm, {NetDemand: on_demand}, timeout_s=CONNECT_S)
    except TransportError as error:
        raise DeployError(f"the router at {place} does not answer: {error}") from error
    with session:
        if not came.wait(EGO_S):
            raise DeployError(
                f"{'no ego' if ego is None else f'no ego {ego}'} of swarm {swarm!r} is heard at "
                f"{place} within {EGO_S:.0f} s: it is away, "
                "or the swarm has another name (--swarm)"
            )
        robots = session.alive()
    first = min(words) if ego is None else ego
    spec = _spec(swarm, robots, words[first], secure=bool(session.name))
    return State(runtime=ELSEWHERE, spec=spec, router=router)


def _spec(swarm: str, robots: tuple[str, ...], demand: NetDemand, *, secure: bool) -> SwarmSpec:
    """What is known of the swarm; where it is recorded is this machine's own business."""
    facts = read_mark(demand.world)
    return SwarmSpec(
        swarm=swarm,
        runtime=ELSEWHERE,
        robots=tuple(sorted({*robots, demand.ego}, key=_by_number)),
        ego=demand.ego,
        world=facts[KIND],
        seed=_whole(facts.get("seed")) or 1,
        scenario=facts.get("scenario", "floor"),
        world_robots=_whole(facts.get("robots")) or None,
        epoch_ns=_whole(facts.get("epoch")),
        secure=secure,
        run_dir="",
        var_dir=str(var_dir_of(swarm)),
    )


def _whole(text: str | None) -> int:
    """A number that another process tells; 0 where it is none."""
    return int(text) if text and text.isascii() and text.isdecimal() and len(text) < 20 else 0


def _by_number(robot: str) -> tuple[str, int]:
    """R2 comes before R10."""
    head = robot.rstrip("0123456789")
    return head, _whole(robot[len(head) :])
