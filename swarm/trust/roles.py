"""The roles of a swarm, as certificates name them (their common name)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, get_args

from swarm.errors import IdentityError, KeyspaceError
from swarm.keyspace import check_name

Kind = Literal[
    "robot", "ego", "router", "authority", "controller", "gateway", "console", "operator", "reader"
]
SITE = ("router", "authority", "controller", "gateway", "console")
"""Roles of which a swarm has one: the common name is the role's."""
PREFIXES: dict[Kind, str] = {
    "ego": "ego-",
    "router": "router-",
    "controller": "controller-",
    "operator": "operator-",
    "reader": "reader-",
}
"""Of roles that have a name: of routers and controllers, those of hosts of their own."""
RULE = f"a robot's id, {', '.join(SITE)}, or {', '.join(p + 'NAME' for p in PREFIXES.values())}"


@dataclass(frozen=True, slots=True)
class Role:
    """A role, and whose: the robot's, ego's, operator's or reader's name, or the name of a host's
    own controller; else empty."""

    kind: Kind
    name: str = ""

    @property
    def common_name(self) -> str:
        """What its certificate says.

        >>> Role("ego", "R1").common_name
        'ego-R1'
        """
        if self.kind in SITE and not self.name:
            return self.kind
        return f"{PREFIXES.get(self.kind, '')}{self.name}"


LOCAL = Role("operator", "local")
"""Who comes over the router's Unix socket: only the swarm's owner can open its folder."""
MAX_OPERATOR = 23
"""Characters of an operator's name, so that the common name can stand in a key."""


def operator_of(user: str) -> Role:
    """The operator that a user of this machine is.

    >>> operator_of("ann@site").common_name
    'operator-ann-site'
    """
    return Role("operator", re.sub(r"[^A-Za-z0-9_-]", "-", user)[:MAX_OPERATOR] or "unknown")


def role_of(common_name: str) -> Role:
    """The role that a common name stands for.

    >>> role_of("R3"), role_of("operator-ann")
    (Role(kind='robot', name='R3'), Role(kind='operator', name='ann'))

    Raises IdentityError for a name that stands for none.
    """
    kind: Kind
    for kind in get_args(Kind):
        if common_name == kind and kind in SITE:
            return Role(kind)
        prefix = PREFIXES.get(kind)
        if prefix and common_name.startswith(prefix):
            return Role(kind, _named(common_name, common_name.removeprefix(prefix)))
    return Role("robot", _named(common_name, common_name))


def _named(common_name: str, name: str) -> str:
    try:
        check_name("name", common_name)
        return check_name("name", name)
    except KeyspaceError as error:
        raise IdentityError(f"{common_name!r} is the name of no role; it must be {RULE}") from error
