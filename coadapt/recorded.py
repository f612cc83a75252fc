"""Recorded data behind one face, whatever it is: a data set's directory, robots' bags, a recording
of a swarm."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from swarm.errors import WorldError, not_installed
from worlds.base import World
from worlds.opv2v.world import Opv2vWorld


@dataclass(frozen=True, slots=True)
class Recorded:
    """Recorded data that is open."""

    path: Path
    world: World
    ego: str
    """The robot that fuses where nobody names one."""
    frames: Sequence[int]
    """The world's frames that were recorded."""
    judged: Sequence[int]
    """Those of which the data says what was really there."""
    notes: tuple[str, ...] = ()
    """What is wrong with data that can be used all the same."""
    unjudged: str = ""
    """Why none is judged."""

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

    def needs_judged(self) -> None:
        """Raises WorldError where no frame says what was really there."""
        if not self.judged:
            raise WorldError(
                f"{self.path} {self.unjudged}: precision needs data with true boxes (OPV2V's "
                "layout, or a recording with its truth)"
            )

    def tell_notes(self) -> None:
        """Prints the notes on standard error."""
        for note in self.notes:
            print(f"coadapt: {note}", file=sys.stderr)


def is_recording(path: Path) -> bool:
    """Whether a path names one file, as recordings of swarms are."""
    return path.is_file() or path.suffix.lower() == ".mcap"


def open_recorded(path: Path) -> Recorded:
    """Opens a recording of a swarm (`.mcap`), a folder of robots' bags, or a directory in OPV2V's
    layout.

    Raises WorldError when it is none of them, or damaged; a recording that is cut off is read up to
    the cut, and has a note.
    """
    if is_recording(path):
        return _recording(path)
    try:
        from options.bags.recording import holds_bags
    except ModuleNotFoundError:  # without the extra `bags` there is nothing that could read them
        bags = False
    else:
        bags = holds_bags(path)
    if bags:
        from options.bags.world import BagWorld

        bag = BagWorld(path)
        words = "holds robots' bags, which do not say what was really there"
        return Recorded(path, bag, bag.robots[0], range(bag.frame_count), (), unjudged=words)
    world = Opv2vWorld(path)
    every = range(world.frame_count)
    return Recorded(path, world, world.robots[0], every, every)


def _recording(path: Path) -> Recorded:
    try:
        from options.recordings.world import RecordingWorld
    except ModuleNotFoundError as error:
        raise WorldError(f"recording {path}: {not_installed(error.name)}") from error
    world = RecordingWorld(path)
    frames, judged = world.recorded_frames(), world.judged_frames()
    notes = list(world.notes)
    if judged and len(judged) < len(frames):
        lacking = len(frames) - len(judged)
        notes.append(f"{path} has {lacking} of {len(frames)} frames without what was really there")
    if (points := world.file.header.points) != "all":
        notes.append(
            f"{path} was recorded with --points {points}: robots that were not asked have no scan"
        )
    words = "does not say what was really there (recorded with --no-truth, or of real robots)"
    return Recorded(path, world, world.ego, frames, judged, tuple(notes), unjudged=words)
