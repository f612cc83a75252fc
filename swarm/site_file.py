"""The site file: places with names, as polygons on the floor.

    {"places": [{"name": "docks", "polygon": [[0, 0], [12.5, 0], [12.5, 8], [0, 8]]}]}

Corners are x and y in the world frame, metres; several polygons with one name are one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from swarm.errors import SettingError
from swarm.files import write_whole
from swarm.messages import Place
from swarm.messages.obeyed import Places

MAX_BYTES = 1_000_000


class _Site(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    places: Places


def read_site(path: Path) -> tuple[Place, ...]:
    """The places of a site file. Raises SettingError that says what is not allowed in it."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise SettingError(f"site file {str(path)!r} cannot be read: {error}") from error
    if len(raw) > MAX_BYTES:
        raise SettingError(f"site file {str(path)!r} is larger than {MAX_BYTES} bytes")
    try:
        return msgspec.json.decode(raw, type=_Site).places
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SettingError(f"site file {str(path)!r} is not valid: {error}") from error


def write_site(path: Path, places: Sequence[Place]) -> None:
    """Writes a site file, whole or not at all. Raises OSError."""
    plain = msgspec.json.encode(_Site(tuple(places)))
    write_whole(path, msgspec.json.format(plain, indent=1) + b"\n")
