"""A robot's settings on any machine: what is typed, its certificate, and what the ego tells."""

from __future__ import annotations

import queue
import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from robot_agent.settings import RobotSettings, load_settings
from swarm import zenoh_config
from swarm.defaults import SWARM
from swarm.errors import SettingError, TransportError
from swarm.fitting import KIND, read_mark
from swarm.keyspace import check_name
from swarm.listening import listen
from swarm.log import make_logger
from swarm.messages import NetDemand
from swarm.scouting import find_router
from swarm.settings import PREFIX
from swarm.trust.identity import CERTIFICATE, Identity

if TYPE_CHECKING:
    from worlds.kinds import WorldKind

TELL_S = 10.0
SCOUT = "scout"
_PLACE = re.compile(r"(tcp|tls)/(\[[^\]]+\]|[^:/\s#]+)(:\d+)?")
LEARNT = {
    KIND: "world",
    "epoch": "epoch_ns",
    "robots": "world_robots",
    "seed": "world_seed",
    "scenario": "world_scenario",
}
"""Facts of a mark that are settings."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What is typed. None, or empty, leaves it to the certificate or the ego."""

    place: str
    """`tcp/HOST[:PORT]` or `tls/HOST[:PORT]`, or SCOUT."""
    robot: str
    cert: Path | None
    swarm: str | None
    settings: Mapping[str, object]
    """By field of `RobotSettings`; those that are None are not given."""

    def given(self) -> dict[str, object]:
        """The settings that are given."""
        return {name: value for name, value in self.settings.items() if value is not None}


def router_of(wish: Wish) -> str:
    """The router's address as a client takes it, checked with the certificate that is shown there.

    Raises SettingError for a malformed address or a certificate where none belongs, IdentityError
    for one that could not be shown.
    """
    place = wish.place
    if place == SCOUT:
        place = find_router("tcp" if wish.cert is None else "tls")
    found = _PLACE.fullmatch(place)
    if found is None:
        raise SettingError(
            f"router {wish.place!r} is not valid; it must be tls/HOST[:PORT] or tcp/HOST[:PORT], "
            f"or {SCOUT} to look for one by multicast"
        )
    router = zenoh_config.with_port(place)
    if found[1] == "tcp":
        if wish.cert is not None:
            raise SettingError(
                f"--cert {wish.cert} is shown to a secure router only, and {router} is a plain "
                f"one: tls/{router.removeprefix('tcp/')}"
            )
    elif wish.cert is None:
        raise SettingError(
            f"{router} wants a certificate: --cert FOLDER, which `coadapt certs issue "
            f"{wish.robot}` makes where the swarm runs"
        )
    else:
        router += f"#identity={folder_of(wish.cert, wish.robot)}"
    zenoh_config.check_router(router, wish.robot)
    return router


def folder_of(cert: Path, name: str) -> Path:
    """The identity's folder: the one that is named, or the one called `name` in it."""
    folder = cert.expanduser().absolute()
    inside = folder / name
    return inside if not (folder / CERTIFICATE).exists() and inside.is_dir() else folder


def swarm_of(router: str, swarm: str | None) -> str:
    """The swarm's name: of a secure one the authority's certificate tells it.

    Raises SettingError where that is not the one that is given, KeyspaceError for no name.
    """
    identity = zenoh_config.identity_of(router)
    told = _swarm_of_authority(identity) if identity is not None else ""
    if swarm and told and swarm != told:
        raise SettingError(
            f"--swarm {swarm} is not the swarm whose authority issued the certificate in "
            f"{identity.folder if identity else ''}: that is {told}"
        )
    return check_name("swarm name", swarm or told or SWARM)


def _swarm_of_authority(identity: Identity) -> str:
    # Only here: the library takes its time, and a plain swarm goes without.
    from swarm.trust.certificates import common_name, read_certificate, swarm_of_authority

    return swarm_of_authority(common_name(read_certificate(identity.ca)))


def needs_ego(given: Mapping[str, object]) -> bool:
    """Whether only the ego can tell in which world, and since when, the robot is to live."""
    if "world" not in given:
        return True
    return "epoch_ns" not in given and _kind(str(given["world"])).data != "address"


def _kind(world: str) -> WorldKind:
    # Only where a world is named: its libraries take half a second.
    from worlds.registry import world_kind

    return world_kind(world)


def learn(router: str, swarm: str, stop: threading.Event) -> dict[str, object]:
    """Settings of the world that the ego lives in, as soon as one is heard.

    Raises TransportError when `stop` was set first, SettingError for an ego that does not tell.
    """
    log = make_logger("join", swarm=swarm)
    heard: queue.SimpleQueue[NetDemand] = queue.SimpleQueue()
    with listen(router, swarm, {NetDemand: heard.put}, log=log, stop=stop):
        waited_s = 0.0
        while not stop.is_set():
            try:
                demand = heard.get(timeout=0.1)
            except queue.Empty:
                waited_s += 0.1
                if waited_s >= TELL_S:
                    waited_s = 0.0
                    place = router.partition("#")[0]
                    why = (
                        f"no ego of swarm {swarm!r} is heard at {place}, so the world is not "
                        "known: the swarm has another name, or --world and --epoch say it"
                    )
                    log.warning("no_ego", why=why)
                continue
            return _told(demand)
    raise TransportError("stopped before an ego was heard")


def _told(demand: NetDemand) -> dict[str, object]:
    if not demand.world:
        raise SettingError(
            f"ego {demand.ego} does not tell in which world it lives (an older version of the "
            "package): --world and --epoch, and what else the world needs, must say it"
        )
    facts = read_mark(demand.world)
    return {LEARNT[name]: value for name, value in facts.items() if name in LEARNT}


def settings_of(
    wish: Wish,
    router: str,
    swarm: str,
    learnt: Mapping[str, object],
    environment: Mapping[str, str],
) -> RobotSettings:
    """The robot's settings: what is typed goes before what was learnt, that before what the
    environment has.

    Raises SettingError for a value that is not allowed.
    """
    given = wish.given()
    if str(given.get("world", learnt.get("world"))) != str(learnt.get("world")):
        # Of another world than the ego's only the time is of use.
        learnt = {"epoch_ns": learnt["epoch_ns"]} if "epoch_ns" in learnt else {}
    own = {"robots": wish.robot, "router": router, "swarm": swarm}
    # Who says otherwise than the ego means it: another start would not help.
    follows = bool(learnt) and all(str(given.get(n, learnt[n])) == str(learnt[n]) for n in learnt)
    values = {**learnt, **given, **own, "world_learnt": follows and "world" in learnt}
    said = {PREFIX + name.upper(): str(value) for name, value in values.items()}
    settings = load_settings({**environment, **said})
    _check(settings, simulated="world_robots" in learnt)
    return settings


CALM = {
    "OMP_NUM_THREADS": "1",
    "OMP_WAIT_POLICY": "PASSIVE",
    "OPENBLAS_NUM_THREADS": "1",
}
"""One numerical thread, and none that spins on a core, unless the machine's owner wants more."""


def _check(settings: RobotSettings, *, simulated: bool) -> None:
    """Raises SettingError where the robot cannot live in its world. `simulated`: as the ego told,
    which says for how many robots there is room."""
    (robot,) = settings.robots
    kind = None if simulated else _kind(settings.world)
    names = [f"R{number}" for number in range(1, settings.world_robots + 1)]
    if (kind is None or kind.numbered) and robot not in names:
        raise SettingError(
            f"--robot {robot} is not one of R1 to {names[-1]}, for which the world has room: start "
            "the swarm with `coadapt up --world-robots N`"
        )
    if kind is None or not kind.data:
        return
    path = Path(settings.world_data)
    if not settings.world_data:
        raise SettingError(f"world {kind.name} needs --data {kind.word}, {kind.needs}")
    if (kind.data == "file" and not path.is_file()) or (
        kind.data == "directory" and not path.is_dir()
    ):
        raise SettingError(f"--data {path} is not there; world {kind.name} needs {kind.needs}")
