"""What is said about links: their state, what egos need of them, what operators make of them."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from swarm.messages.base import Count, Mark, Message, Ns, RobotId, Software

Direction = Literal["down", "up"]
"""`down` goes to the robot, `up` comes from it."""
Directions = Literal["down", "up", "both"]
Profile = Literal["rate", "shift", "trace", "congest", "relieve", "off", "show"]
"""`relieve` ends what `congest` began; `off` ends shapes as well."""
ClassName = Literal["control", "fusion", "background"]

MIN_RATE_BPS = 32_000
"""What six robots need to be known at all: below this, beacons alone fill the link."""
MAX_RATE_BPS = 10_000_000_000
MAX_DURATION_S = 7 * 24 * 3600.0
Rate = Annotated[int, msgspec.Meta(ge=MIN_RATE_BPS, le=MAX_RATE_BPS)]
Duration = Annotated[float, msgspec.Meta(gt=0, le=MAX_DURATION_S)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Backlog(msgspec.Struct, frozen=True, kw_only=True):
    """Counters of a queue that only grow. While it stands, the link behind it is the limit: what
    leaves it then is what that link carries."""

    seen_ms: Count = 0
    """For how long it has been watched."""
    sent_bytes: Count = 0
    """Left it in all."""
    stood_ms: Count = 0
    """For how long more waited than could leave."""
    stood_bytes: Count = 0
    """Left it in that time."""


class LinkClass(msgspec.Struct, frozen=True, kw_only=True):
    """One traffic class on one link: what it may have, and what went through it."""

    rate_bps: Count
    """Guaranteed."""
    ceil_bps: Count
    priority: Count
    """The class with the smallest number gets what nobody else's guarantee takes."""
    throughput_bps: Count
    """Sent since the last state."""
    sent_bytes: Count
    backlog_bytes: Count
    drops: Count
    """Packets, since the class was made; so are the overlimits."""
    overlimits: Count
    backlog: Backlog = Backlog()
    """Of its queue, sampled several times a second since the controller found it."""


class LinkState(msgspec.Struct, frozen=True, kw_only=True):
    """One shaped direction of one robot's link. An ego's cell is its own link downwards."""

    robot: RobotId
    direction: Direction
    capacity_bps: Annotated[int, msgspec.Meta(ge=1)]
    """What was configured, and read back from the kernel; in a cell that egos share, what the link
    is guaranteed of it."""
    available_bps: Count
    """What fusion can have now, with what control and background take at present."""
    latency_ms: NonNegative
    """Configured delay, and how long a byte of fusion waits in the queue now."""
    level: Count
    """How far the controller has moved bandwidth towards fusion; 0 is the normal state."""
    classes: dict[ClassName, LinkClass]
    grants: dict[RobotId, Count] = msgspec.field(default_factory=dict)
    """Each ego's fair part of `available_bps`, where egos share the link."""


class NetState(Message, frozen=True, kw_only=True):
    """The links that a network controller has shaped; 1 Hz. A link that is missing is unshaped."""

    controller: Count
    """Random number drawn at the controller's start: there is one controller a host."""
    seq: Count
    sent_ns: Ns
    links: tuple[LinkState, ...] = ()
    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{0,32}(?!\n)$")] = ""
    """The controller's, where there is one a host; it is the last part of its keys."""
    robots: Annotated[tuple[RobotId, ...], msgspec.Meta(max_length=1024)] = ()
    """Whose links it has, shaped or not: requests for these go to it."""
    unshaped: Annotated[
        tuple[Annotated[str, msgspec.Meta(max_length=300)], ...], msgspec.Meta(max_length=64)
    ] = ()
    """Why links cannot be shaped here, or are not as they should be. Of such a link only what egos
    measure is known."""

    def link(self, robot: str, direction: Direction) -> LinkState | None:
        """The state of one direction of a robot's link, or None where it is not shaped."""
        for state in self.links:
            if (state.robot, state.direction) == (robot, direction):
                return state
        return None


class TcpState(Message, frozen=True, kw_only=True):
    """What the kernel tells a router of its own connections of the fusion class; 2 Hz, those that
    carried something or stood since the last one."""

    router: Count
    """Random number drawn at the router's start."""
    seq: Count
    sent_ns: Ns
    peers: Annotated[
        dict[Annotated[str, msgspec.Meta(max_length=64)], Backlog], msgspec.Meta(max_length=256)
    ]
    """By address and port of the other end (`10.77.1.1:40332`): of what the router sends there."""


class NetDemand(Message, frozen=True, kw_only=True):
    """What an ego needs of its cell to reach Q_min; every control cycle."""

    ego: RobotId
    cycle: Count
    sent_ns: Ns
    needed_bytes_s: Count
    """Fusion traffic of the cheapest decision that reaches Q_min, with the ego's headroom on top;
    0 when the ego alone reaches it, or when no decision does on any link (`possible` is false)."""
    possible: bool
    """Some decision reaches Q_min on a link without limits."""
    reachable: bool
    """Such a decision fits C(t), and what was chosen arrives."""
    unreachable_s: NonNegative
    """For how long the link has kept the ego below Q_min; 0 while it does not."""
    quality: Ratio
    """Predicted quality of the decision in force."""
    q_min: Ratio
    capacity_bps: Count
    """C(t) that the ego reckons with."""
    steady_ns: Ns = 0
    """When it was sent on the ego's steady clock, for robots to echo; 0: it does not say."""
    control_bps: Count = 0
    """What the beacons and scenes of each robot may take of the way to this ego; 0: no limit."""
    fewer_bps: Annotated[dict[RobotId, Count], msgspec.Meta(max_length=256)] = msgspec.field(
        default_factory=dict
    )
    """The same of robots whose own beacons stand in a queue."""
    world: Mark = ""
    """The mark of the ego's world (`swarm.fitting`); empty: it does not say."""
    software: Software = ""
    """The version of the ego's package."""
    told: Annotated[
        dict[RobotId, Annotated[str, msgspec.Meta(max_length=400)]], msgspec.Meta(max_length=64)
    ] = msgspec.field(default_factory=dict)
    """Robots that do not fit, or about which something is odd, and what: another world or version,
    an id that two processes use, a clock that is off."""
    mean_bytes_s: Count = 0
    """Fusion traffic of the decision in force, on average."""
    burst_bytes: Count = 0
    """Of its largest fused frame; 0: it does not say."""


class ShapeRequest(Message, frozen=True, kw_only=True):
    """An operator's wish for a link."""

    request: Count = 0
    operator: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """Who asks; it stands in the controller's journal."""
    robot: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{0,32}(?!\n)$")] = ""
    """Whose link; empty is the cell towards the ego, of `relieve` and `off` every link."""
    direction: Directions = "down"
    profile: Profile
    rate_bps: Rate | None = None
    """Needed by `rate`; `congest` takes 85 % of the capacity without one."""
    rates_bps: Annotated[tuple[Count, ...], msgspec.Meta(max_length=100_000)] = ()
    """Needed by `trace`: the capacity of one interval after the other, from the start again at
    the end. A rate that is too small for a link is raised to the smallest possible one."""
    interval_s: Annotated[float, msgspec.Meta(ge=0.1, le=3600)] = 1.0
    time_scale: Annotated[float, msgspec.Meta(gt=0, le=100_000)] = 1.0
    """Seconds of the profile a second: `shift` takes 24 h at 1."""
    duration_s: Duration | None = None
    """The shape expires after this; None: it stays until it is changed."""
    delay_ms: Annotated[float, msgspec.Meta(ge=0, le=10_000)] = 0.0
    loss: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.0
    protocol: Literal["udp", "tcp", "both"] = "both"
    """Of `congest`."""
    revision: Count | None = None
    """Refuse unless the shapes have this revision: somebody else may have changed them."""


class ShapeInForce(msgspec.Struct, frozen=True, kw_only=True):
    """What an operator has made of one direction of one link."""

    robot: RobotId
    direction: Direction
    profile: Profile
    rate_bps: Count
    """At this moment; 0 while the link is not there."""
    operator: str
    since_ns: Ns
    until_ns: Ns
    """When it expires; 0: never."""
    delay_ms: NonNegative = 0.0
    loss: Ratio = 0.0


class ShapeReply(Message, frozen=True, kw_only=True):
    """The shapes after a request was carried out. A refused request changes nothing."""

    request: Count
    revision: Count
    """Counts changes by operators; expiry counts, too."""
    shapes: tuple[ShapeInForce, ...]
    congested: tuple[RobotId, ...] = ()
    """Robots towards which telemetry flows run."""
    notes: tuple[str, ...] = ()
    """What the operator should know: whose shape was replaced, what this kernel lacks."""
