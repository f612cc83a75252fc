"""Who has rights at a router: a file beside its certificate, a common name a line.

The keystore writes it; the router reads it again when it, or its certificate, has changed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from swarm.errors import IdentityError
from swarm.files import write_whole
from swarm.trust.access import access_control
from swarm.trust.identity import Identity, stamp
from swarm.trust.roles import LOCAL, Role, role_of

MEMBERS = "members"


@dataclass(frozen=True, slots=True)
class Trust:
    """Who a router is, and Zenoh's `access_control` of what others may do."""

    identity: Identity
    access: dict[str, Any]


def write_members(router: Identity, names: Iterable[str]) -> None:
    """Writes who has rights, unless it is written there already. Raises OSError."""
    path = router.folder / MEMBERS
    text = "".join(f"{name}\n" for name in sorted(set(names)))
    if not path.exists() or path.read_bytes() != text.encode():
        write_whole(path, text)


def read_members(router: Identity) -> tuple[Role, ...]:
    """Raises IdentityError for a list that cannot be read, or a name that is no role's."""
    path = router.folder / MEMBERS
    try:
        names = path.read_text().split()
    except (OSError, UnicodeDecodeError) as error:
        raise IdentityError(
            f"{path}, who has rights at the router, cannot be read: {error}; "
            "`coadapt certs issue router` writes it anew"
        ) from error
    return tuple(role_of(name) for name in names)


def trust_of(router: Identity, swarm: str) -> Trust:
    """What a router needs to know to let in whom it should. Raises IdentityError."""
    return Trust(router, access_control(swarm, read_members(router), LOCAL))


def version(router: Identity) -> tuple[int, ...]:
    """Another one as soon as certificate or members have changed."""
    return (*router.version(), *stamp(router.folder / MEMBERS))
