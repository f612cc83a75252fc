"""Whether recorded data will fuse: what it holds, and what speaks against it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from perception.detector import configuration
from perception.detector.suits import ScanProfile
from swarm.errors import WorldError
from swarm.geometry import Points, transform
from worlds.base import World, comm_range_of
from worlds.remarks import Choosing, Noted, detector_remarks, scans_like
from worlds.timing import Timed, Timing, overlap_s, skew_by_ends, skew_by_lag

FRAMES = 12
"""Looked at, evenly over the recording."""
CELL_M = 1.0
"""Side of the cells in which what robots see is counted."""
LITTLE = 0.02
"""A robot within range that shares less of what it sees with the ego may count from an origin of
its own."""


@dataclass(frozen=True, slots=True)
class Partner:
    """Another robot, as the ego finds it over the frames that were looked at."""

    robot: str
    nearest_m: float
    farthest_m: float
    within: float
    """Share of frames in which both have a scan and the robot is within range."""
    shared: float
    """Share of the cells that it sees then which the ego sees, too."""


@dataclass(frozen=True, slots=True)
class Check:
    """What was found out about a recorded world."""

    robots: tuple[str, ...]
    ego: str
    frames: int
    rate_hz: float
    span_s: float
    timings: tuple[Timing, ...]
    """Empty where the data does not say when each scan was taken."""
    overlap_s: float
    skew: tuple[str, float] | None
    """The robot whose clock may differ from the first one's, and by how much it is ahead."""
    scans: ScanProfile | None
    detector: str
    chosen: tuple[str, ...]
    unsuited: tuple[str, ...]
    """Why the detector does not suit."""
    comm_range_m: float
    seen: dict[str, float]
    """Share of frames in which each robot has a scan."""
    partners: tuple[Partner, ...]
    gain: float
    """Cells that ego and partners within range see together, for each that it sees alone."""
    apart: tuple[str, ...]
    """Robots whose poses may count from an origin of their own, and why."""
    unreadable: tuple[str, ...]
    """Robots of which a scan could not be read, and why not."""
    notes: tuple[str, ...]
    against: tuple[str, ...] = field(default=())
    """Why nothing can be fused; empty where it can."""

    @property
    def fuses(self) -> bool:
        """Whether the ego fuses another robot's scan in any of the frames."""
        return not self.against


def check(world: World, ego: str | None = None) -> Check:
    """Looks at a recorded world with one of its robots as the ego (default: the first).

    Raises WorldError for an ego that is not there, and for poses that cannot be read.
    """
    ego = ego or world.robots[0]
    if ego not in world.robots:
        raise WorldError(f"robot {ego!r} is not there; there are {', '.join(world.robots)}")
    frames = sorted(
        {int(at) for at in np.linspace(0, world.frame_count - 1, min(FRAMES, world.frame_count))}
    )
    range_m, seen = comm_range_of(world), scans_like(world)
    faults: dict[str, str] = {}
    cells = {
        robot: [_cells(world, robot, frame, faults) for frame in frames] for robot in world.robots
    }
    partners = tuple(
        _partner(world, ego, robot, frames, cells, range_m)
        for robot in world.robots
        if robot != ego
    )
    timings = world.timings if isinstance(world, Timed) else ()
    span_s = world.frame_count / world.rate_hz
    return Check(
        robots=world.robots,
        ego=ego,
        frames=world.frame_count,
        rate_hz=world.rate_hz,
        span_s=max((one.span_s for one in timings), default=span_s),
        timings=timings,
        overlap_s=overlap_s(timings) if timings else span_s,
        skew=(skew_by_lag(timings) or skew_by_ends(timings)) if timings else None,
        scans=seen,
        detector=world.detector,
        chosen=world.choices if isinstance(world, Choosing) else (),
        unsuited=detector_remarks(world, seen),
        comm_range_m=range_m,
        seen={robot: float(np.mean([bool(its) for its in cells[robot]])) for robot in cells},
        partners=partners,
        gain=_gain(world, ego, frames, cells, range_m),
        apart=tuple(_apart(ego, partners, min(configuration(world.detector).usual_body.size[:2]))),
        unreadable=tuple(f"{robot}: {why}" for robot, why in faults.items()),
        notes=world.notes if isinstance(world, Noted) else (),
        against=tuple(_against(ego, cells, partners, range_m)),
    )


def _against(
    ego: str, cells: dict[str, list[set[int]]], partners: Sequence[Partner], range_m: float
) -> list[str]:
    if not partners:
        return [f"{ego} is alone: there is nobody to fuse with"]
    if not any(cells[ego]):
        return [f"{ego} has no scan in the frames that were looked at"]
    if any(one.within for one in partners):
        return []
    near = min(partners, key=lambda one: one.nearest_m)
    if near.nearest_m > range_m:
        return [
            f"no robot comes within {range_m:.0f} m of {ego}: {near.robot}, the nearest, is "
            f"{near.nearest_m:.0f} m away (comm_range_m in world.toml, or --comm-range)"
        ]
    return [f"no robot within {range_m:.0f} m of {ego} has a scan while {ego} has one"]


def _apart(ego: str, partners: Sequence[Partner], width_m: float) -> Iterator[str]:
    for one in partners:
        if one.nearest_m < width_m:
            yield (
                f"{one.robot} comes within {one.nearest_m:.1f} m of {ego}, where there is no room "
                "for both"
            )
        elif one.within and one.shared < LITTLE:
            yield f"{one.robot} sees almost nothing of what {ego} sees, within range of it"


def _partner(
    world: World,
    ego: str,
    robot: str,
    frames: Sequence[int],
    cells: dict[str, list[set[int]]],
    range_m: float,
) -> Partner:
    distances = [world.pose(ego, at).distance_to(world.pose(robot, at)) for at in frames]
    both = [
        (own, its)
        for own, its, distance in zip(cells[ego], cells[robot], distances, strict=True)
        if own and its and distance <= range_m
    ]
    shared = [len(own & its) / len(its) for own, its in both]
    return Partner(
        robot=robot,
        nearest_m=min(distances),
        farthest_m=max(distances),
        within=len(both) / len(frames),
        shared=float(np.mean(shared)) if shared else 0.0,
    )


def _gain(
    world: World,
    ego: str,
    frames: Sequence[int],
    cells: dict[str, list[set[int]]],
    range_m: float,
) -> float:
    ratios = []
    for at, frame in enumerate(frames):
        together = set(cells[ego][at])
        for robot in world.robots:
            if world.pose(ego, frame).distance_to(world.pose(robot, frame)) <= range_m:
                together |= cells[robot][at]
        if cells[ego][at]:
            ratios.append(len(together) / len(cells[ego][at]))
    return float(np.mean(ratios)) if ratios else 1.0


def _cells(world: World, robot: str, frame: int, faults: dict[str, str]) -> set[int]:
    """The cells of the world's ground plane in which a scan has points. One that cannot be read has
    none; the first one's reason goes to `faults`."""
    points: Points = np.zeros((0, 3), dtype=np.float32)
    try:
        scan = world.scan(robot, frame)
        points = transform(scan.pose.matrix(), scan.points)
    except WorldError as error:
        faults.setdefault(robot, str(error))
    at = np.floor(points[:, :2] / CELL_M).astype(np.int64)
    return set((at[:, 0] * (1 << 32) + at[:, 1]).tolist())
