"""Recordings of running swarms: written as MCAP, shown live in Foxglove, replayed and compared."""

from __future__ import annotations

from pathlib import Path

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest


def _open(request: WorldRequest) -> World:
    from options.recordings.world import RecordingWorld

    return RecordingWorld(Path(request.data))


WORLDS = (WorldKind("recording", _open, "file", "the file of a recording (`coadapt record`)"),)
