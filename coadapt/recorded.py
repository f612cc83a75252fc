"""Recorded data behind one face, whatever it is: a recording of a swarm, a data set's directory,
robots' bags, folders of scans."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from swarm.errors import WorldError
from worlds.base import World
from worlds.opv2v.world import Opv2vWorld
from worlds.registry import find_kind, open_world, world_kinds
from worlds.remarks import remarks


@runtime_checkable
class OfASwarm(Protocol):
    """A world that a swarm left behind: frames may lack, and somebody was the ego."""

    ego: str

    def recorded_frames(self) -> Sequence[int]:
        """Those of the world's frames for which no other stands in."""
        ...

    def judged_frames(self) -> Sequence[int]:
        """Those of the recorded frames that come with what was really there."""
        ...


@dataclass(frozen=True, slots=True)
class Recorded:
    """Recorded data that is open."""

    path: Path
    found: str
    """What it is, in words."""
    world: World
    ego: str
    """The robot that fuses where nobody names one."""
    frames: Sequence[int]
    """The world's frames that were recorded."""

    def frame(self, name: str) -> int:
        """The world's frame for a frame's name in a data set (006220), or the number of a recorded
        one from 0. Raises WorldError for one that is not there."""
        if isinstance(self.world, Opv2vWorld):
            return self.world.frame_index(name)
        if name.isdecimal() and int(name) < len(self.frames):
            return self.frames[int(name)]
        raise WorldError(
            f"frame {name!r} is not in {self.path}; it has 0 to {len(self.frames) - 1}"
        )

    def judged(self) -> Sequence[int]:
        """The frames of which the data says what was really there. Raises WorldError where there
        are none."""
        if isinstance(self.world, OfASwarm):
            frames = self.world.judged_frames()
        else:
            truth = self.world.ground_truth
            frames = self.frames if any(len(truth(frame).boxes) for frame in self.frames) else ()
        if not frames:
            raise WorldError(
                f"{self.path} holds {self.found} and does not say what was really there: "
                "precision needs true boxes (OPV2V's layout, or a recording of a simulated swarm "
                "without --no-truth)"
            )
        return frames

    def tell_notes(self) -> None:
        """Prints on standard error what is wrong with data that can be used all the same."""
        for remark in remarks(self.world):
            print(f"coadapt: {remark}", file=sys.stderr)


def names_data(text: str) -> bool:
    """Whether a world's name or a path is a path."""
    return text not in world_kinds() and (Path(text).exists() or text != Path(text).stem)


def open_recorded(path: Path) -> Recorded:
    """Opens what lies at a path, a file or a directory.

    Raises WorldError where that is nothing known, or damaged; a recording that is cut off is read
    up to the cut, and has a note.
    """
    kind, words = find_kind(path)
    world = open_world(kind.name, data=path)
    if isinstance(world, OfASwarm):
        return Recorded(path, words, world, world.ego, world.recorded_frames())
    return Recorded(path, words, world, world.robots[0], range(world.frame_count))
