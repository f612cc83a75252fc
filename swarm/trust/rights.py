"""What each role may do on each key: the least that it needs. Everything else is denied.

The acts are Zenoh's, in the words of the project: to *put* a message, to *listen* to a key, to
*serve* queries on it, to *ask* there, to *hold* a liveliness token and to *watch* tokens.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from swarm import keyspace
from swarm.keyspace import ANY
from swarm.trust.roles import Role

Act = Literal["put", "listen", "serve", "ask", "hold", "watch"]
ANNOUNCED = ("robot", "ego", "controller")
"""What may join from elsewhere tells where its metrics are; only the router's own process hears it.
"""


@dataclass(frozen=True, slots=True)
class Right:
    """One act that is allowed on one key expression."""

    act: Act
    key: str


def rights_of(role: Role, swarm: str) -> tuple[Right, ...]:
    """All that a role may do in a swarm."""
    acts = _acts(role, swarm)
    if role.kind not in ("router", "authority"):
        acts["ask"] = (*acts.get("ask", ()), keyspace.trust_certificate(swarm))
    return tuple(Right(act, key) for act, keys in acts.items() for key in keys)


def _acts(role: Role, swarm: str) -> dict[Act, tuple[str, ...]]:
    own = role.name
    acts = _own_acts(role, swarm, own)
    if role.kind in ANNOUNCED:
        place = keyspace.metrics(swarm, role.common_name)
        acts["hold"] = (*acts.get("hold", ()), place)
    return acts


def _own_acts(role: Role, swarm: str, own: str) -> dict[Act, tuple[str, ...]]:
    match role.kind:
        case "robot":
            return {
                "put": (*_told_by(swarm, own), keyspace.shared(swarm, own, ANY)),
                "hold": (keyspace.alive(swarm, own),),
                "serve": (
                    keyspace.observation(swarm, own),
                    keyspace.robot_steering(swarm, own),
                ),
                "listen": (keyspace.net_demand(swarm),),
            }
        case "ego":
            return {
                "put": (
                    keyspace.decision(swarm, own),
                    keyspace.detections(swarm, own),
                    keyspace.net_demand(swarm),
                ),
                # As a standby, it leads while the first ego is away.
                "hold": (keyspace.ego_leads(swarm, own),),
                "listen": (
                    *_told_by(swarm, ANY),
                    keyspace.shared(swarm, ANY, ANY),
                    keyspace.decision(swarm, ANY),
                    keyspace.net_state(swarm, ANY),
                    keyspace.net_tcp(swarm),
                ),
                "watch": (
                    keyspace.alive(swarm, ANY),
                    keyspace.ego_leads(swarm, ANY),
                    keyspace.llm_alive(swarm),
                ),
                "ask": (
                    keyspace.observation(swarm, ANY),
                    keyspace.llm_decide(swarm),
                    # Whether its own robot is on duty.
                    keyspace.robot_steering(swarm, own),
                ),
                "serve": (keyspace.ego_steering(swarm, own),),
            }
        case "router":
            # It says nothing itself: its own process is not subject to its rules, and what another
            # machine's router may pass on is `access`' business.
            return {}
        case "authority":
            return {"serve": (keyspace.trust_certificate(swarm),)}
        case "controller":
            return {
                "put": (keyspace.net_state(swarm, own),),
                "listen": (keyspace.net_demand(swarm),),
                "serve": (keyspace.net_shape(swarm, own),),
            }
        case "gateway":
            return {
                "put": (keyspace.llm_state(swarm),),
                "hold": (keyspace.llm_alive(swarm),),
                "serve": (keyspace.llm_decide(swarm), keyspace.llm_wish(swarm)),
            }
        case "console" | "operator":
            return {
                **_reading(swarm),
                "ask": (
                    keyspace.net_shape(swarm, ANY),
                    keyspace.ego_steering(swarm, ANY),
                    keyspace.robot_steering(swarm, ANY),
                    keyspace.llm_wish(swarm),
                ),
            }
        case "reader":
            return _reading(swarm)


def _reading(swarm: str) -> dict[Act, tuple[str, ...]]:
    return {
        "listen": (
            *_told_by(swarm, ANY),
            keyspace.decision(swarm, ANY),
            keyspace.detections(swarm, ANY),
            keyspace.net_demand(swarm),
            keyspace.net_state(swarm, ANY),
            keyspace.net_tcp(swarm),
            keyspace.llm_state(swarm),
        ),
        "watch": (
            keyspace.alive(swarm, ANY),
            keyspace.ego_leads(swarm, ANY),
            keyspace.llm_alive(swarm),
        ),
    }


def _told_by(swarm: str, robot: str) -> tuple[str, ...]:
    """What a robot tells of itself, in whatever cell of the floor."""
    return tuple(keyspace.anywhere(key(swarm, robot)) for key in (keyspace.beacon, keyspace.scene))
