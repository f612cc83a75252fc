"""Whether a machine has room for a swarm's processes."""

from __future__ import annotations

from pathlib import Path

from swarm.errors import PropertyError

FEW_ROBOTS = 100
"""So many are always tried."""
ROBOT_MB = 60
"""What a robot's process takes of its own before it encodes anything (`Pss`)."""
MEMORY = Path("/proc/meminfo")


def check_room(robots: int) -> None:
    """Raises PropertyError where the memory does not hold the processes of so many robots.

    On a system that does not tell what is free, nothing is checked.
    """
    try:
        told = dict(line.split(":", 1) for line in MEMORY.read_text().splitlines())
        free_mb = int(told["MemAvailable"].split()[0]) * 1024 / 1e6
    except (OSError, ValueError, KeyError):
        return
    most = max(FEW_ROBOTS, int(free_mb / ROBOT_MB))
    if robots > most:
        rule = f"at most {most} here: each takes {ROBOT_MB} MB, and {free_mb / 1e3:.0f} GB are free"
        raise PropertyError("robots", robots, str(robots), rule)
