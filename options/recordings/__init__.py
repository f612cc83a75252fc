"""Recordings of running swarms: written as MCAP, shown live in Foxglove, replayed and compared."""

from __future__ import annotations

from pathlib import Path

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest, robot_count


def _open(request: WorldRequest) -> World:
    from options.recordings.world import RecordingWorld

    return RecordingWorld(Path(request.data))


def _found(path: Path) -> str:
    from options.recordings.file import RecordingFile

    if not path.is_file():
        return ""
    return f"a recording of {robot_count(len(RecordingFile(path).header.robots))}"


NEEDS = "the file of a recording (`coadapt record`)"
WORLDS = (WorldKind("recording", _open, "file", NEEDS, found=_found),)
