"""What somebody who opens a world should hear of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Protocol, runtime_checkable

from perception.detector import configuration
from perception.detector.suits import ScanProfile, misfits, profile
from swarm.errors import WorldError
from worlds.base import World

FRAMES = 5
"""Looked at to tell what the scans are like, evenly over the recording."""
MAX_SCANS = 20


@runtime_checkable
class Noted(Protocol):
    """A world that has something to say of its data."""

    notes: tuple[str, ...]
    """What is odd about data that can be used all the same."""


@runtime_checkable
class Choosing(Protocol):
    """A world that has chosen something that its data does not name."""

    choices: tuple[str, ...]
    """What was chosen, and why."""


def remarks(world: World) -> Iterator[str]:
    """What is odd about a recorded world, what it has chosen, and whether its detector suits."""
    if isinstance(world, Noted):
        yield from world.notes
    if isinstance(world, Choosing):
        yield from world.choices
    yield from detector_remarks(world, scans_like(world))


def scans_like(world: World) -> ScanProfile | None:
    """What the scans of a recorded world are like; None where there is too little in them."""
    scans = []
    step = max(1, world.frame_count // FRAMES)
    for frame in range(0, world.frame_count, step):
        for robot in world.robots[: max(1, MAX_SCANS // FRAMES)]:
            with suppress(WorldError):  # told when that scan is asked for
                scans.append(world.scan(robot, frame).points)
    return profile(scans)


def detector_remarks(world: World, seen: ScanProfile | None) -> tuple[str, ...]:
    """Why the detector of a world does not suit its scans; nothing where it does."""
    if seen is None:
        return ()
    reasons = misfits(seen, configuration(world.detector))
    if not reasons:
        return ()
    return (
        f"detector {world.detector} does not suit the scans: {'; '.join(reasons)}; expect boxes "
        "that are missing or wrong",
    )
