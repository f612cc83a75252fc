"""Which robots' scans a folder holds, and in which order they were taken."""

from __future__ import annotations

import re
from pathlib import Path

from swarm.errors import WorldError
from worlds.plain.poses import NAMES
from worlds.robot_name import check_robot_name
from worlds.scans import READERS, is_scan

INSIDE = ("scans", "velodyne", "lidar", "points")
"""A folder in a robot's own that may hold its scans: KITTI has `velodyne`."""


def robots_of(folder: Path) -> dict[str, list[Path]]:
    """The scans of each robot by its name, in the order of their numbers; none where no folder
    holds scans. Raises WorldError when a folder cannot be read."""
    try:
        folders = sorted(path for path in folder.iterdir() if path.is_dir())
        found = {path.name: scan_files(path) for path in folders if path.name[0] != "."}
    except OSError as error:
        raise WorldError(f"data directory {folder} cannot be read: {error}") from error
    return {name: files for name, files in found.items() if files}


def scan_files(folder: Path) -> list[Path]:
    """The scans of one robot, `9.bin` before `10.bin`. Raises OSError."""
    for place in (folder, *(folder / name for name in INSIDE)):
        if place.is_dir():
            files = [path for path in place.iterdir() if is_scan(path) and path.name not in NAMES]
            if files:
                return sorted(files, key=_number)
    return []


def check_robots(folder: Path, robots: dict[str, list[Path]]) -> None:
    """Raises WorldError where no robot has scans, or one cannot be called so."""
    if not robots:
        here = (
            "; its scans lie in it itself: put them into one folder a robot"
            if scan_files(folder)
            else ""
        )
        raise WorldError(
            f"data directory {folder} holds no folder with scans ({', '.join(READERS)}), one a "
            f"robot{here}"
        )
    for name in robots:
        check_robot_name(f"folder {folder / name}", name)


def _number(path: Path) -> tuple[tuple[int, int, str], ...]:
    parts = re.split(r"(\d+)", path.name)
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts)
