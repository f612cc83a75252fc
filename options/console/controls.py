"""What operators may ask for here: what `coadapt net`, `steer` and `wish` send."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from swarm import keyspace
from swarm.messages import (
    EgoSteered,
    EgoSteering,
    Message,
    RobotSteered,
    RobotSteering,
    ShapeReply,
    ShapeRequest,
    WishAnswer,
    WishRequest,
)


@dataclass(frozen=True, slots=True)
class Control:
    """One kind of request, and who answers it."""

    request: type[Message]
    reply: type[Message]
    key: Callable[[str, str, str], str]
    """From the swarm, its ego and the robot or controller that is named."""


CONTROLS = {
    "shape": Control(
        ShapeRequest, ShapeReply, lambda swarm, ego, who: keyspace.net_shape(swarm, who)
    ),
    "ego": Control(
        EgoSteering, EgoSteered, lambda swarm, ego, who: keyspace.ego_steering(swarm, ego)
    ),
    "wish": Control(WishRequest, WishAnswer, lambda swarm, ego, who: keyspace.llm_wish(swarm)),
    "robot": Control(
        RobotSteering, RobotSteered, lambda swarm, ego, who: keyspace.robot_steering(swarm, who)
    ),
}
