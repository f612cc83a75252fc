"""The site file: places with names, as polygons on the floor.

    {"places": [{"name": "docks", "polygon": [[0, 0], [12.5, 0], [12.5, 8], [0, 8]]}],
     "words": {"docks": ["loading bay", "Rampe"]}}

Corners are x and y in the world frame, metres; several polygons with one name are one place.
`words` are what people call it besides.
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from swarm.errors import SettingError
from swarm.files import write_whole
from swarm.messages.intent import OtherWords
from swarm.messages.obeyed import Places

MAX_BYTES = 1_000_000


class SiteFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a site file holds."""

    places: Places
    words: OtherWords = msgspec.field(default_factory=dict)
    brought: str = ""
    """Which places `up` wrote here; empty: somebody else wrote the file."""

    def names(self) -> tuple[str, ...]:
        """The places' names, each once."""
        return tuple(dict.fromkeys(place.name for place in self.places))


def read_site(path: Path) -> SiteFile:
    """A site file. Raises SettingError that says what is not allowed in it."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise SettingError(f"site file {str(path)!r} cannot be read: {error}") from error
    if len(raw) > MAX_BYTES:
        raise SettingError(f"site file {str(path)!r} is larger than {MAX_BYTES} bytes")
    try:
        return msgspec.json.decode(raw, type=SiteFile)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SettingError(f"site file {str(path)!r} is not valid: {error}") from error


def write_site(path: Path, site: SiteFile) -> None:
    """Writes a site file, whole or not at all. Raises SettingError for one that could not be read
    again, OSError."""
    plain = msgspec.json.encode(site)
    try:
        msgspec.json.decode(plain, type=SiteFile)
    except msgspec.ValidationError as error:
        raise SettingError(f"site file {str(path)!r} would not be valid: {error}") from error
    pretty = msgspec.json.format(plain, indent=1) + b"\n"
    if len(pretty) > MAX_BYTES:
        raise SettingError(f"site file {str(path)!r} would be larger than {MAX_BYTES} bytes")
    write_whole(path, pretty)
