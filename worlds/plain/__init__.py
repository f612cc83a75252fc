"""Folders of plain scans: a file a scan, a folder a robot."""

from __future__ import annotations

from pathlib import Path

from worlds.base import World
from worlds.kinds import WorldKind, WorldRequest, robot_count


def _open(request: WorldRequest) -> World:
    from worlds.plain.world import ScansWorld

    return ScansWorld(Path(request.data))


def _found(path: Path) -> str:
    from worlds.plain.folders import check_robots, robots_of, scan_files

    # A scenario of OPV2V has such folders, too.
    plain = path.is_dir() and not (path / "data_protocol.yaml").is_file()
    robots = robots_of(path) if plain else {}
    if plain and not robots and scan_files(path):
        check_robots(path, robots)
    return f"plain scans of {robot_count(len(robots))}" if robots else ""


NEEDS = "the directory of the robots' folders of scans"
WORLDS = (WorldKind("scans", _open, "directory", NEEDS, found=_found),)
