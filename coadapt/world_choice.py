"""Which world a swarm lives in, found out and opened before anything is started."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deploy.progress import say, typed
from swarm.errors import DeployError, WorldError
from worlds.kinds import WorldKind, WorldRequest
from worlds.registry import find_kind, world_kind

if TYPE_CHECKING:
    from worlds.base import World

FIRST_SCANS = 5
"""Of each robot, of which one at least must be readable."""


def chosen_kind(name: str | None, data: str, otherwise: str) -> WorldKind:
    """The world that is named, else the one whose data that is, else `otherwise`.

    Raises WorldError for an unknown one and for data of none, DeployError for data that the world
    does not read.
    """
    if name is None:
        if not data:
            return world_kind(otherwise)
        kind, words = find_kind(Path(data))
        say(f"{data} holds {words}: world {kind.name}")
        return kind
    kind = world_kind(name)
    if data and not kind.data:
        raise DeployError(
            f"world {name} is simulated and reads no data, but there is --data {data}; "
            f"leave out the one or the other{_told(data)}"
        )
    return kind


def open_chosen(kind: WorldKind, request: WorldRequest) -> tuple[tuple[str, ...], float]:
    """The robots of the world, as many as are wished for at most, and how far from the ego one of
    them may take part; says what is odd about recorded data.

    Raises DeployError where it cannot be used, and tells which world's data it is instead.
    """
    # Imported here: the other commands need no arrays.
    from worlds.base import comm_range_of
    from worlds.remarks import remarks

    try:
        world = kind.open_checked(request)
        robots = world.robots[: request.robots]
        if request.data:
            _read_some(world, robots)
    except WorldError as error:
        told = _told(request.data, kind.name) if request.data else ""
        raise DeployError(f"{error}{told}") from error
    if request.data:
        for remark in remarks(world):
            say(remark)
        say(f"{request.data} has the robots {', '.join(robots)}")
    return robots, comm_range_of(world)


def _told(data: str, other: str = "") -> str:
    """What data is, and what to type, where it is of another world than `other`."""
    try:
        kind, words = find_kind(Path(data))
    except WorldError:
        return ""
    if kind.name == other:
        return ""
    return f" (it holds {words}: `{typed('up', world=kind.name, data=data)}`)"


def _read_some(world: World, robots: Sequence[str]) -> None:
    """Raises WorldError where none of the first scans of a robot can be read."""
    frames = min(FIRST_SCANS, world.frame_count)
    for robot in robots:
        for frame in range(frames):
            try:
                world.scan(robot, frame)
                break
            except WorldError:
                if frame == frames - 1:
                    raise
