"""What a robot of recorded data may be called."""

from __future__ import annotations

import re

from swarm.errors import WorldError

_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
"""The rule of `swarm.keyspace.check_name`; worlds know nothing of keys."""


def check_robot_name(source: str, name: str) -> None:
    """Raises WorldError, which begins with the `source` of the name, where it may not stand in a
    key."""
    if not _NAME.fullmatch(name):
        raise WorldError(
            f"{source} names a robot {name!r}, which is not allowed: use 1 to 32 letters, digits, "
            "'_' or '-'"
        )
