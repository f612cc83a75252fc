"""What a kind of world says of itself: its name, its data, and how it is opened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from perception.detector import configuration
from swarm.errors import WorldError, not_installed
from worlds.base import World


@dataclass(frozen=True, slots=True)
class Reader:
    """The process that opens a world, as a live robot is told it."""

    process: str
    robot: str
    log: Any
    """A structlog logger."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldRequest:
    """What a world is opened with; each kind takes what concerns it."""

    data: str = ""
    """Recorded data, or a live robot's address, as the kind's `needs` says."""
    robots: int = 6
    """Number of simulated robots."""
    seed: int = 1
    """Of everything random in a simulated world."""
    rings: int = 32
    """Of the simulated LiDAR of `factory`; `road` has OPV2V's."""
    room: float = 1.0
    """Floor of `factory` a robot, of what is usual."""
    scenario: str = "floor"
    cache: Path | None = None
    """Directory in which scans are kept between runs; None keeps none."""
    reader: Reader | None = None


@dataclass(frozen=True, slots=True)
class WorldKind:
    """One kind of world; a module that has `WORLDS = (WorldKind(...),)` adds it (registry.py)."""

    name: str
    open: Callable[[WorldRequest], World]
    """Imports what is heavy when it is called."""
    data: Literal["", "directory", "file", "address"] = ""
    """What `data` must be; empty where a world needs none."""
    needs: str = ""
    """The same in words: "the directory of ..."."""
    sample: Callable[[], Path] | None = None
    """Where data lies that is taken where none is named; raises WorldError when it is not there."""
    found: Callable[[Path], str] | None = None
    """What of this kind lies at a path, in words like "bags of 2 robots", found out by looking;
    empty where nothing does. It may raise WorldError."""
    numbered: bool = False
    """Whether its robots are R1 to Rn, as many as are asked for; only a world that is open knows
    the names of others."""
    detector: str = ""
    """The configuration that fits its worlds; empty where each world, by its data, has its own."""

    @property
    def comm_range_m(self) -> float | None:
        """How far from the ego a robot may take part; None where only a world that is open says
        it (`worlds.base.comm_range_of`)."""
        return configuration(self.detector).comm_range_m if self.detector else None

    @property
    def word(self) -> str:
        """How `data` is written in an example."""
        return {"directory": "DIR", "file": "FILE"}.get(self.data, "ADDRESS")

    def open_checked(self, request: WorldRequest) -> World:
        """Opens it. Raises WorldError where its data cannot be used, or a package is missing."""
        if self.data and not request.data:
            raise WorldError(f"world {self.name!r} needs {self.needs} (DATA={self.word})")
        try:
            return self.open(request)
        except ModuleNotFoundError as error:
            raise WorldError(f"world {self.name!r}: {not_installed(error.name)}") from error


def robot_count(count: int) -> str:
    """So many robots, in words."""
    return f"{count} robot{'' if count == 1 else 's'}"
