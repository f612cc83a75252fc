"""Zenoh's access control at the router, written from `rights`: everything else is denied."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from swarm.keyspace import ANY, by, everything
from swarm.trust.rights import Act, rights_of
from swarm.trust.roles import Role


@dataclass(frozen=True, slots=True)
class _Passage:
    """What passes the router for an act: from the process (ingress) or towards it (egress)."""

    flow: Literal["ingress", "egress"]
    messages: tuple[str, ...]
    by: Literal["", "own", "any"] = ""
    """By whose name: of questions, that of the one who asks."""


UNIX = "unix:local"
"""The subject that comes over the Unix socket; no common name has a colon."""

_PASSAGES: dict[Act, tuple[_Passage, ...]] = {
    "put": (_Passage("ingress", ("put",)),),
    "listen": (
        _Passage("ingress", ("declare_subscriber",)),
        _Passage("egress", ("put",)),
    ),
    "serve": (
        _Passage("ingress", ("declare_queryable", "reply"), by="any"),
        _Passage("egress", ("query",), by="any"),
    ),
    "ask": (
        _Passage("ingress", ("query",), by="own"),
        _Passage("egress", ("reply",), by="own"),
        _Passage("egress", ("declare_queryable",), by="any"),
    ),
    "hold": (_Passage("ingress", ("liveliness_token",)),),
    "watch": (
        _Passage("ingress", ("declare_liveliness_subscriber", "liveliness_query")),
        _Passage("egress", ("liveliness_token",)),
    ),
}


_PASSED_ON = (
    "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
    "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
)  # fmt: skip
"""Between routers everything of the swarm passes, both ways: each holds its own processes to their
rights where they come in, and believes of the others that they do."""


def access_control(swarm: str, roles: Iterable[Role], local: Role) -> dict[str, Any]:
    """The configuration `access_control` of a router.

    `roles` are known by their certificates' common names. `local` is what a process may do that
    comes over the router's Unix socket, whose folder only the swarm's owner can open.
    """
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    members = [(role.common_name, role, "tls") for role in roles]
    members.append((UNIX, local, "unixsock-stream"))
    for subject, role, protocol in members:
        named = {} if protocol != "tls" else {"cert_common_names": [subject]}
        subjects.append({"id": subject, "link_protocols": [protocol], **named})
        own = _rules(subject, role, swarm)
        rules += own
        if own:
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(subject: str, role: Role, swarm: str) -> list[dict[str, Any]]:
    if role.kind == "router":
        return [
            {
                "id": f"{subject} pass on",
                "permission": "allow",
                "flows": ["ingress", "egress"],
                "messages": list(_PASSED_ON),
                "key_exprs": [everything(swarm)],
            }
        ]
    keys: dict[Act, list[str]] = {}
    for right in rights_of(role, swarm):
        keys.setdefault(right.act, []).append(right.key)
    names = {"own": role.common_name, "any": ANY}
    return [
        {
            "id": f"{subject} {act} {number}",
            "permission": "allow",
            "flows": [passage.flow],
            "messages": list(passage.messages),
            "key_exprs": [by(key, names[passage.by]) if passage.by else key for key in own],
        }
        for act, own in keys.items()
        for number, passage in enumerate(_PASSAGES[act], 1)
    ]
