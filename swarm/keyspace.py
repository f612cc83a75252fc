"""The key space: one function a key, so that no other file spells a key."""

from __future__ import annotations

import re

from swarm.errors import KeyspaceError

_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
_CELL = re.compile(r"-?\d{1,6}_-?\d{1,6}")
_IN_CELLS = ("beacon", "scene")
ANY = "*"


def check_name(kind: str, name: str) -> str:
    """Returns a swarm name or robot id that may stand in a key.

    Raises KeyspaceError when it may not.
    """
    if not _NAME.fullmatch(name):
        raise KeyspaceError(
            f"{kind} {name!r} is not allowed: use 1 to 32 letters, digits, '_' or '-'"
        )
    return name


def _robot_key(swarm: str, robot: str, leaf: str) -> str:
    if robot != ANY:
        check_name("robot id", robot)
    return f"coadapt/{check_name('swarm name', swarm)}/robot/{robot}/{leaf}"


def _ego_key(swarm: str, ego: str, leaf: str) -> str:
    if ego != ANY:
        check_name("ego id", ego)
    return f"coadapt/{check_name('swarm name', swarm)}/ego/{ego}/{leaf}"


def _net_key(swarm: str, leaf: str) -> str:
    return f"coadapt/{check_name('swarm name', swarm)}/net/{leaf}"


def _controller_key(swarm: str, leaf: str, controller: str) -> str:
    if controller == ANY:
        return _net_key(swarm, f"{leaf}/**")  # also the one without a name
    if controller:
        return _net_key(swarm, f"{leaf}/{check_name('controller name', controller)}")
    return _net_key(swarm, leaf)


def _llm_key(swarm: str, leaf: str) -> str:
    return f"coadapt/{check_name('swarm name', swarm)}/llm/{leaf}"


def alive(swarm: str, robot: str) -> str:
    """Liveliness token of a robot: join and leave."""
    return _robot_key(swarm, robot, "alive")


def beacon(swarm: str, robot: str) -> str:
    """`messages.Beacon`, 10 Hz.

    >>> beacon("local", "R1")
    'coadapt/local/robot/R1/beacon'
    """
    return _robot_key(swarm, robot, "beacon")


def scene(swarm: str, robot: str) -> str:
    """`messages.SceneDescription`, 2 Hz."""
    return _robot_key(swarm, robot, "scene")


def within(key: str, cell: str) -> str:
    """Where a robot tells its beacon or scene on a site that is divided into cells
    (`areas.cell_of`), so that who is interested in a part of the floor hears that part only.

    >>> within(beacon("local", "R1"), "3_-4")
    'coadapt/local/robot/R1/beacon/3_-4'
    """
    return f"{key}/{cell}"


def anywhere(key: str) -> str:
    """A beacon's or scene's key in whatever cell, or in none.

    >>> anywhere(beacon("local", ANY))
    'coadapt/local/robot/*/beacon/**'
    """
    return f"{key}/**"


def observation(swarm: str, robot: str) -> str:
    """Queryable: `messages.ObservationRequest` -> `messages.Observation`."""
    return _robot_key(swarm, robot, "observation")


def shared(swarm: str, robot: str, algorithm: str) -> str:
    """`messages.Observation` that a robot publishes once for several egos, every frame.

    >>> shared("local", "R1", "early")
    'coadapt/local/robot/R1/shared/early'
    """
    return _robot_key(swarm, robot, f"shared/{algorithm}")


def decision(swarm: str, ego: str) -> str:
    """`messages.Decision`, every control cycle."""
    return _ego_key(swarm, ego, "decision")


def detections(swarm: str, ego: str) -> str:
    """`messages.Detections`, every fused frame."""
    return _ego_key(swarm, ego, "detections")


def ego_steering(swarm: str, ego: str) -> str:
    """Queryable: `messages.EgoSteering` -> `messages.EgoSteered`."""
    return _ego_key(swarm, ego, "steering")


def ego_leads(swarm: str, ego: str) -> str:
    """Liveliness token of an ego that has one to stand in for it, or stands in: it leads."""
    return _ego_key(swarm, ego, "leads")


def robot_steering(swarm: str, robot: str) -> str:
    """Queryable: `messages.RobotSteering` -> `messages.RobotSteered`."""
    return _robot_key(swarm, robot, "steering")


def net_state(swarm: str, controller: str = "") -> str:
    """`messages.NetState`, 1 Hz, from the network controller, or from the one of that name where
    there is one a host; ANY is all of them.

    >>> net_state("local"), net_state("local", "hall-2"), net_state("local", ANY)
    ('coadapt/local/net/state', 'coadapt/local/net/state/hall-2', 'coadapt/local/net/state/**')
    """
    return _controller_key(swarm, "state", controller)


def net_tcp(swarm: str) -> str:
    """`messages.TcpState`, 2 Hz, from a router."""
    return _net_key(swarm, "tcp")


def net_demand(swarm: str) -> str:
    """`messages.NetDemand` of every ego, every control cycle."""
    return _net_key(swarm, "demand")


def net_shape(swarm: str, controller: str = "") -> str:
    """Queryable of the network controller, or of the one of that name: `messages.ShapeRequest` ->
    `messages.ShapeReply`."""
    return _controller_key(swarm, "shape", controller)


def llm_decide(swarm: str) -> str:
    """Queryable of the LLM gateway: `messages.DecideRequest` -> `messages.DecideAnswer`."""
    return _llm_key(swarm, "decide")


def llm_wish(swarm: str) -> str:
    """Queryable of the LLM gateway: `messages.WishRequest` -> `messages.WishAnswer`."""
    return _llm_key(swarm, "wish")


def llm_state(swarm: str) -> str:
    """`messages.GatewayState`, 1 Hz, from the LLM gateway."""
    return _llm_key(swarm, "state")


def llm_alive(swarm: str) -> str:
    """Liveliness token of the LLM gateway."""
    return _llm_key(swarm, "alive")


def trust_certificate(swarm: str) -> str:
    """Queryable of a secure swarm's authority: `messages.CertificateRequest` ->
    `messages.RenewedCertificate`."""
    return f"coadapt/{check_name('swarm name', swarm)}/trust/certificate"


def metrics(swarm: str, role: str, place: str = ANY) -> str:
    """Liveliness token of a process that serves metrics, by its role's common name, with the place
    where it does (`announce.PLACE`).

    >>> metrics("local", "ego-R1", "http:10.0.0.7:9102")
    'coadapt/local/metrics/ego-R1/http:10.0.0.7:9102'
    """
    if role != ANY:
        check_name("role", role)
    return f"coadapt/{check_name('swarm name', swarm)}/metrics/{role}/{place}"


def metrics_of(key: str) -> tuple[str, str]:
    """The common name and the place in a key of `metrics`. Raises KeyspaceError for another key."""
    parts = key.split("/")
    if len(parts) != 5 or parts[0] != "coadapt" or parts[2] != "metrics":
        raise KeyspaceError(f"key {key!r} is not coadapt/<swarm>/metrics/<role>/<place>")
    return parts[3], parts[4]


def everything(name: str) -> str:
    """All keys of the swarm of that name: what its routers pass on to each other.

    >>> everything("local")
    'coadapt/local/**'
    """
    return f"coadapt/{check_name('swarm name', name)}/**"


def by(key: str, asker: str) -> str:
    """Where a role asks what is served on a key, in a secure swarm: the router lets each ask by its
    own name only, so that who serves knows who asks. Served is `by(key, ANY)`.

    >>> by("coadapt/local/net/shape", "operator-ann")
    'coadapt/local/net/shape/by/operator-ann'
    """
    return f"{key}/by/{asker}"


def asker_of(key: str) -> str:
    """By whose name a query came; empty where its key is not one of `by`."""
    head, _, asker = key.rpartition("/")
    return asker if head.endswith("/by") else ""


def controller_of(key: str) -> str:
    """Which network controller a key of `net_state` is of; empty: the one without a name."""
    parts = key.split("/")
    return parts[4] if len(parts) > 4 else ""


def belongs_to_robot(key: str) -> bool:
    """Whether a robot or ego id stands in the key; only its own messages may come on it."""
    parts = key.split("/")
    return len(parts) > 2 and parts[2] in ("robot", "ego")


def robot_of(key: str) -> str:
    """The robot or ego id in a key of this key space. Raises KeyspaceError for another key."""
    parts = key.split("/")
    if len(parts) == 6 and parts[4] in _IN_CELLS and _CELL.fullmatch(parts[5]):
        parts.pop()
    whole = len(parts) == 5 or (len(parts) == 6 and parts[4] == "shared")
    if not whole or parts[0] != "coadapt" or parts[2] not in ("robot", "ego"):
        raise KeyspaceError(f"key {key!r} is not coadapt/<swarm>/(robot|ego)/<id>/<leaf>")
    return check_name("robot id", parts[3])
