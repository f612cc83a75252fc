"""Worlds by name: every module or package in `worlds/` and `options/` that has `WORLDS`.

To add a world, add one file with a class and `WORLDS = (WorldKind(...),)`; no list needs to be
changed. Options are looked for where they are installed, and loaded when they are asked for.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from swarm.errors import WorldError, not_installed
from swarm.registry import by_name, registered
from worlds.base import World
from worlds.kinds import Reader, WorldKind, WorldRequest

ROOMS = ("worlds", "options")


@cache
def world_kinds() -> dict[str, WorldKind]:
    """All kinds by name, sorted. Raises WorldError where two have the same name."""
    return by_name(registered("WORLDS", *ROOMS), "worlds", WorldError)


def world_kind(name: str) -> WorldKind:
    """The kind of that name. Raises WorldError for an unknown one."""
    kinds = world_kinds()
    if name not in kinds:
        raise WorldError(f"world {name!r} is not known; allowed: {', '.join(kinds)}")
    return kinds[name]


def find_kind(path: Path) -> tuple[WorldKind, str]:
    """The kind of world whose data lies at a path, and what was found, in words.

    Raises WorldError where there is none, or more than one.
    """
    found: list[tuple[WorldKind, str]] = []
    reasons: list[str] = []
    if not path.exists():
        raise WorldError(f"{path} is not there")
    for kind in world_kinds().values():
        try:
            words = kind.found(path) if kind.found else ""
        except WorldError as error:
            reasons.append(f"{kind.name}: {error}")
        except ModuleNotFoundError as error:
            reasons.append(f"{kind.name}: {not_installed(error.name)}")
        else:
            found += [(kind, words)] if words else []
    if len(found) > 1:
        kinds = "; ".join(f"{kind.name}: {words}" for kind, words in found)
        raise WorldError(f"{path} holds data of several worlds ({kinds}); keep one kind")
    if not found:
        wanted = "; ".join(
            f"{kind.name}: {kind.needs}" for kind in world_kinds().values() if kind.found
        )
        why = "".join(f"\n  not {reason}" for reason in reasons)
        raise WorldError(f"{path} holds no data that is known; allowed: {wanted}{why}")
    return found[0]


def swarm_worlds() -> tuple[str, ...]:
    """Names of the worlds that a swarm on one machine can live in: all but a live robot's."""
    return tuple(name for name, kind in world_kinds().items() if kind.data != "address")


def data_words() -> str:
    """Which of these worlds need data, and what: "bag: the directory of ...; ..."."""
    kinds = (world_kind(name) for name in swarm_worlds())
    return "; ".join(f"{kind.name}: {kind.needs}" for kind in kinds if kind.data)


def open_world(
    name: str,
    *,
    data: Path | str | None = None,
    robots: int = 6,
    seed: int = 1,
    rings: int = 32,
    room: float = 1.0,
    scenario: str = "floor",
    cache: Path | None = None,
    reader: Reader | None = None,
) -> World:
    """The world of that name; WorldRequest says what the values are.

    >>> world = open_world("factory", robots=3, rings=16)
    >>> world.robots
    ('R1', 'R2', 'R3')
    >>> scan = world.scan("R1", 0)
    >>> scan.points.dtype, scan.points.shape[1]
    (dtype('float32'), 3)

    Raises WorldError for an unknown name, missing data or a value that the world does not allow.
    """
    request = WorldRequest(
        data=str(data or ""),
        robots=robots,
        seed=seed,
        rings=rings,
        room=room,
        scenario=scenario,
        cache=cache,
        reader=reader,
    )
    return world_kind(name).open_checked(request)
