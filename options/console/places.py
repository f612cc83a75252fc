"""Places of the site: shown on the floor, drawn, named otherwise and taken away by hand."""

from __future__ import annotations

import threading
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from options.console.answers import Places
from swarm.errors import SettingError
from swarm.messages import Place
from swarm.messages.intent import Name
from swarm.messages.obeyed import Polygon
from swarm.site_edit import drawn, removed, renamed
from swarm.site_file import SiteFile, read_site, write_site


class PlaceChange(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What an operator does to one place."""

    act: Literal["draw", "rename", "delete"]
    name: Name
    polygon: Polygon | None = None
    """Of what is drawn."""
    part: bool = False
    """What is drawn is one more part of a place that is there."""
    to: Name | None = None
    """The new name; None: as it was."""
    words: Annotated[tuple[Name, ...], msgspec.Meta(max_length=16)] = ()
    """What people call it besides."""


class SitePlaces:
    """The site file as the console reads and writes it. Threads may share it."""

    def __init__(self, path: str, own: Sequence[Place]) -> None:
        """`path`: of the site file; empty: there is none. `own`: the world's places, which hold
        until the file is there."""
        self._path = Path(path) if path else None
        self._own = SiteFile(tuple(own))
        self._lock = threading.Lock()

    def read(self) -> SiteFile:
        """What holds now, whoever wrote it. Raises SettingError."""
        if self._path is None or not self._path.exists():
            return self._own
        return read_site(self._path)

    def shown(self) -> Places:
        """As pages are told."""
        drawable = self._path is not None
        try:
            site = self.read()
        except SettingError as error:
            return Places(places=(), drawable=drawable, trouble=str(error))
        return Places(places=site.places, words=site.words, drawable=drawable)

    def change(self, change: PlaceChange, robots: Collection[str]) -> Places:
        """Makes a change, and gives what is shown then. `robots`: names that no place may have.

        Raises SettingError that says what is not allowed; the file stays as it was then.
        """
        if self._path is None:
            raise SettingError("no site file is set by COADAPT_CONSOLE_SITE: nothing can be drawn")
        with self._lock:
            site = _changed(self.read(), change, robots)
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                write_site(self._path, site)
            except OSError as error:
                path = str(self._path)
                raise SettingError(f"site file {path!r} cannot be written: {error}") from error
        return self.shown()


def _changed(site: SiteFile, change: PlaceChange, robots: Collection[str]) -> SiteFile:
    match change.act:
        case "draw":
            if change.polygon is None:
                raise SettingError(f"place {change.name!r} has no polygon")
            return drawn(
                site,
                change.name,
                change.polygon,
                words=change.words,
                part=change.part,
                robots=robots,
            )
        case "rename":
            to = change.to or change.name
            return renamed(site, change.name, to, words=change.words, robots=robots)
        case "delete":
            return removed(site, change.name)
