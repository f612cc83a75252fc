"""Worlds, policies, drivers and the like by name, found where they are.

To add one, put a file into its package that has it in a constant, such as `POLICIES = (Mine,)`; no
list needs to be changed.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Iterator
from typing import Any, Protocol, TypeVar

from swarm.errors import CoAdaptError


class Named(Protocol):
    """What has a name to be asked for by."""

    @property
    def name(self) -> str:
        """Unlike all others'."""
        ...


N = TypeVar("N", bound=Named)


def registered(constant: str, *packages: str) -> Iterator[Any]:
    """What modules of these packages hold in a constant, by order of the modules' names.

    It imports them: what is heavy, they import where they use it. Packages that are not installed
    are passed over.
    """
    for package in packages:
        try:
            places = importlib.import_module(package).__path__
        except ModuleNotFoundError as error:
            if error.name != package:
                raise
            continue
        for name in sorted(module.name for module in pkgutil.iter_modules(places)):
            yield from getattr(importlib.import_module(f"{package}.{name}"), constant, ())


def by_name(things: Iterable[N], kind: str, error: type[CoAdaptError]) -> dict[str, N]:
    """Things by their names, sorted. Raises `error` where two of the `kind` share one."""
    found: dict[str, N] = {}
    for thing in things:
        if thing.name in found:
            raise error(f"two {kind} are called {thing.name!r}")
        found[thing.name] = thing
    return dict(sorted(found.items()))
