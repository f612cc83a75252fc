"""What operators may change while a swarm runs: how an ego decides, which robots are on duty."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from swarm.messages.base import Count, Message, Ns, RobotId

Operator = Annotated[str, msgspec.Meta(max_length=64)]
PolicyName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]
Duty = Literal["on", "off", "ask"]
QMin = Annotated[float, msgspec.Meta(ge=0, le=1)]


class EgoWish(msgspec.Struct, frozen=True, kw_only=True):
    """What an operator wants of an ego's decisions; one that names nothing only asks."""

    policy: PolicyName | None = None
    q_min: QMin | None = None


class EgoSteering(Message, frozen=True, kw_only=True):
    """An operator's request to an ego."""

    request: Count = 0
    operator: Operator = ""
    """Who asks; it stands in the ego's log."""
    wish: EgoWish


class EgoSteered(Message, frozen=True, kw_only=True):
    """How an ego decides from its next cycle on. A refused request changes nothing."""

    request: Count
    ego: RobotId
    policy: PolicyName
    q_min: QMin
    policies: tuple[PolicyName, ...]
    """Those that it knows."""


class RobotSteering(Message, frozen=True, kw_only=True):
    """An operator's request to a robot."""

    request: Count = 0
    operator: Operator = ""
    """Who asks; it stands in the robot's log, and in its replies."""
    duty: Duty


class RobotSteered(Message, frozen=True, kw_only=True):
    """Whether a robot is part of the swarm: off duty it is not alive for anybody, tells nothing and
    answers no request for observations, but its process runs."""

    request: Count
    robot: RobotId
    on_duty: bool
    operator: Operator = ""
    """Who changed it last; empty where nobody has."""
    since_ns: Ns = 0
    """When, on the robot's clock; 0 where nobody has."""
