"""Bags as one stretch of time: what all of them cover, and whether their clocks agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from options.bags.log import RobotLog, seconds
from swarm.errors import WorldError
from worlds.timing import Timing, overlap_s, skew_by_ends, skew_by_lag
from worlds.world_file import FILE_NAME

FEW = 0.9
"""Less of a robot's scans than this share is worth a word."""


def common_span(data: Path, logs: Sequence[RobotLog]) -> tuple[int, int]:
    """The first and last moment that all bags cover.

    Raises WorldError where there is none, or where the clocks differ.
    """
    skew = skew_by_lag([log.timing for log in logs])
    if skew is not None:
        robot, ahead_s = skew
        raise WorldError(
            f"the clocks of {logs[0].robot} and {robot} in {data} are {abs(ahead_s):.3f} s apart: "
            f"scans of {robot} are stamped that much "
            f"{'later' if ahead_s > 0 else 'earlier'}, compared with when they were recorded; "
            f"{_remedy(robot, ahead_s)}, or 0 where the stamps are right"
        )
    first, last = max(log.first_ns for log in logs), min(log.last_ns for log in logs)
    if first > last:
        spans = "; ".join(f"{log.robot} {seconds(log.first_ns, log.last_ns)}" for log in logs)
        apart = skew_by_ends([log.timing for log in logs])
        why = f"; if they were made at once, {_remedy(*apart)}" if apart else ""
        raise WorldError(f"the bags of {data} share no time: {spans}{why}")
    return first, last


def words(timings: Sequence[Timing]) -> Iterator[str]:
    """What is odd about the times of bags that can be used all the same."""
    for one in timings:
        if one.disordered:
            yield (
                f"{one.disordered} of {one.scans} scans of {one.robot} were recorded out of order; "
                "they are taken in the order of their stamps"
            )
        if one.lost:
            yield f"{one.robot} lacks {one.lost} scans between its {one.scans}"
    shared = overlap_s(timings)
    longest = max(timings, key=lambda one: one.span_s)
    if shared < FEW * longest.span_s:
        apart = skew_by_ends(timings)
        why = f"; if they were made at once, {_remedy(*apart)}" if apart else ""
        yield (
            f"the bags share {shared:.1f} s, the longest ({longest.robot}) has "
            f"{longest.span_s:.1f} s{why}"
        )


def _remedy(robot: str, ahead_s: float) -> str:
    return f"[robots.{robot}] of {FILE_NAME} needs clock_offset_s = {ahead_s:.3f}"
