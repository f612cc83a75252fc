"""What must hold whatever happens; pure functions of what was seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise

import msgspec

from research.chaos.history import LET_IN, Cycle, Frame, History, Played
from research.chaos.memory import slopes
from research.chaos.recovery import missing_by, recovery

LATE_MS = 2_000.0
"""A frame that is heard so much older than it says was shown as fresh."""
KNOWN_S = 2.0
"""A robot that was heard longer ago is not shown (`beacon_max_age_s`, 1 s, and a frame's time)."""
FRAME_AGE_MS = 6_000.0
"""The greatest deadline, 4 s, and what fusing takes; an older frame is not published."""
HELD = ("kill-router", "stop-router", "clock-ego")
"""Faults in which frames arrive late, or are dated with two clocks, and say so or cannot know."""
UNHIT_CYCLES = 3
"""A robot may be out for fewer, as a busy machine has them."""
LONG_RUN_S = 1_200.0
RSS_MB_PER_H = 1.0


class Broken(msgspec.Struct, frozen=True, kw_only=True):
    """Something that did not hold."""

    rule: str
    at_s: float
    what: str


Rule = Callable[[History, int], Iterator[Broken]]


def broken(history: History, recovery_cycles: int) -> tuple[Broken, ...]:
    """Everything that did not hold, in the order of time; `recovery_cycles` is the bound for
    everybody to be back."""
    found = [one for rule in RULES for one in rule(history, recovery_cycles)]
    return tuple(sorted(found, key=lambda one: (one.at_s, one.rule)))


def gaps(history: History) -> tuple[list[tuple[float, int]], int]:
    """Cycles that are missing while the ego ran, as (when, how many), and how many are missing
    because it did not."""
    missed, down = [], 0
    for before, after in pairwise(history.cycles):
        count = round((after.at_s - before.at_s) / history.period_s) - 1
        if count <= 0:
            continue
        if any(_overlap(one, before, after) for one in history.played if one.ego_down):
            down += count
        else:
            missed.append((before.at_s, count))
    return missed, down


def lost_lines(history: History) -> list[tuple[float, int]]:
    """Decisions that were heard and are in no line, as (when, cycle). The cycle in which the ego
    was killed is not completed, and has none."""
    written = {(one.cycle, one.started_ns) for one in history.cycles}
    kills = [one for one in history.played if one.ego_down]
    return [
        (one.at_s, one.cycle)
        for one in history.decisions
        if (one.cycle, one.decided_ns) not in written
        and one.at_s < history.seconds - 2 * history.period_s
        and not any(k.begun_s - 2 * history.period_s <= one.at_s <= k.begun_s for k in kills)
    ]


def holes(history: History) -> list[tuple[float, int]]:
    """Cycle numbers that no line has, as (when, how many)."""
    return [
        (after.at_s, after.cycle - before.cycle - 1)
        for before, after in pairwise(history.cycles)
        if after.cycle != before.cycle + 1
    ]


def hijacked(history: History) -> list[tuple[float, str]]:
    """Frames in which a stranger's part was taken, as (when, what)."""
    ours = set(history.robots)
    found = []
    for frame in history.frames:
        strangers = set(frame.participants[1:]) - ours
        if strangers:
            found.append((frame.at_s, f"{', '.join(sorted(strangers))} took part"))
        for robot in history.robots:
            if not _attacked(history, frame, robot):
                continue
            if frame.missing.get(robot) == "rejected":
                found.append((frame.at_s, f"a stranger's payload for {robot} was decoded"))
            if robot in frame.participants and frame.sizes.get(robot) == history.foreign_bytes:
                found.append((frame.at_s, f"a stranger's payload for {robot} was fused"))
    return found


def _every_cycle(history: History, _: int) -> Iterator[Broken]:
    for at_s, count in gaps(history)[0]:
        yield Broken(rule="decision in every cycle", at_s=at_s, what=f"{count} cycles were missed")
    period_ms = history.period_s * 1e3
    for cycle in history.cycles:
        if cycle.cycle_ms > period_ms and not _stood_still(history, cycle):
            what = f"cycle {cycle.cycle} took {cycle.cycle_ms:.0f} of {period_ms:.0f} ms"
            yield Broken(rule="decision by its deadline", at_s=cycle.at_s, what=what)
    if not history.cycles:
        yield Broken(rule="decision in every cycle", at_s=0.0, what="there is no cycle at all")


def _valid(history: History, _: int) -> Iterator[Broken]:
    for cycle in history.cycles:
        if not cycle.valid and not any(_is_after(one, cycle, history) for one in history.played):
            what = f"the decision of cycle {cycle.cycle} is not valid"
            yield Broken(rule="valid decision", at_s=cycle.at_s, what=what)
        if cycle.cost_bps > cycle.capacity_bps:
            what = (
                f"cycle {cycle.cycle} decided for {cycle.cost_bps / 1e6:.1f} Mbit/s on a link of "
                f"{cycle.capacity_bps / 1e6:.1f} Mbit/s"
            )
            yield Broken(rule="no decision over the link", at_s=cycle.at_s, what=what)


def _journal(history: History, _: int) -> Iterator[Broken]:
    for at_s, count in holes(history):
        yield Broken(rule="journal without a hole", at_s=at_s, what=f"{count} lines are missing")
    for at_s, cycle in lost_lines(history):
        what = f"cycle {cycle} was published and has no line"
        yield Broken(rule="journal without a hole", at_s=at_s, what=what)


def _hijacked(history: History, _: int) -> Iterator[Broken]:
    for at_s, what in hijacked(history):
        yield Broken(rule="no stranger's part", at_s=at_s, what=what)


def _fresh(history: History, _: int) -> Iterator[Broken]:
    for frame in history.frames:
        if frame.known_s > KNOWN_S:
            what = f"frame {frame.frame} shows a robot of {frame.known_s:.1f} s ago"
            yield Broken(rule="nothing stale as fresh", at_s=frame.at_s, what=what)
        held = any(
            (one.ego_down or one.fault.kind in HELD)
            and one.begun_s <= frame.at_s <= _until(one) + history.period_s
            for one in history.played
        )
        if held:
            continue
        if frame.late_ms > LATE_MS:
            what = f"frame {frame.frame} is {frame.late_ms:.0f} ms older than it says"
            yield Broken(rule="nothing stale as fresh", at_s=frame.at_s, what=what)
        if frame.age_ms > FRAME_AGE_MS:
            what = f"frame {frame.frame} was {frame.age_ms:.0f} ms old when it was published"
            yield Broken(rule="nothing stale as fresh", at_s=frame.at_s, what=what)


def _back(history: History, bound: int) -> Iterator[Broken]:
    for one in history.played:
        name = f"{one.fault.kind} {one.fault.target}".strip()
        if one.error:
            continue
        found = recovery(history, one)
        if found.disturbed or (found.cycles is not None and found.cycles <= bound):
            continue
        took = "not at all" if found.cycles is None else f"after {found.cycles} cycles"
        what = f"after {name}, which ended at {one.ended_s:.1f} s, everybody was back {took}"
        yield Broken(rule="back in bounded time", at_s=one.ended_s, what=what)


def _unhit(history: History, _: int) -> Iterator[Broken]:
    out: Counter[str] = Counter()
    for cycle in history.cycles:
        missing = missing_by(history, cycle)
        for robot in history.robots:
            out[robot] = out[robot] + 1 if robot in missing else 0
            if out[robot] == UNHIT_CYCLES:
                what = (
                    f"{robot} was out of {UNHIT_CYCLES} cycles in a row up to {cycle.cycle} "
                    f"without a fault: {cycle.out[robot]}"
                )
                yield Broken(rule="nobody else is hit", at_s=cycle.at_s, what=what)


def _stranger(history: History, _: int) -> Iterator[Broken]:
    for one in history.played:
        if one.seen.startswith(LET_IN):
            yield Broken(rule="no stranger is let in", at_s=one.begun_s, what=one.seen)


def _no_worse_than_alone(history: History, _: int) -> Iterator[Broken]:
    seen = history.seen
    if seen is not None and seen.ap_70 < seen.ap_70_alone:
        what = (
            f"AP@0.7 over {seen.frames} frames is {seen.ap_70:.3f}, and of the ego alone "
            f"{seen.ap_70_alone:.3f}"
        )
        yield Broken(rule="no worse than the ego alone", at_s=history.seconds, what=what)


def _memory(history: History, _: int) -> Iterator[Broken]:
    if history.seconds < LONG_RUN_S:
        return
    for one in slopes(history.memory):
        if one.mb_per_h - 2 * one.error_mb_per_h > RSS_MB_PER_H:
            what = f"{one.service} grows by {one.mb_per_h} ± {one.error_mb_per_h} MB an hour"
            yield Broken(rule="memory does not grow", at_s=history.seconds, what=what)


RULES: tuple[Rule, ...] = (
    _every_cycle, _valid, _journal, _hijacked, _stranger, _no_worse_than_alone, _fresh, _back,
    _unhit, _memory,
)  # fmt: skip


def during(history: History, at_s: float) -> str:
    """The faults that lasted at that time, or had ended less than two cycles before."""
    found = [
        f"{one.fault.kind} {one.fault.target}".strip()
        for one in history.played
        if one.begun_s <= at_s <= _until(one) + 2 * history.period_s
    ]
    return ", ".join(found) or "no fault"


def _until(one: Played) -> float:
    return one.ended_s if one.up_s is None else one.up_s


def _overlap(one: Played, before: Cycle, after: Cycle) -> bool:
    return one.begun_s <= after.at_s and before.at_s <= max(_until(one), one.ended_s)


def _is_after(one: Played, cycle: Cycle, history: History) -> bool:
    """An ego that has just begun has seen nothing yet."""
    return one.ego_down and one.begun_s <= cycle.at_s <= _until(one) + 3 * history.period_s


def _stood_still(history: History, cycle: Cycle) -> bool:
    end_s = cycle.at_s + cycle.cycle_ms * 1e-3
    return any(
        one.ego_down and one.begun_s <= end_s and cycle.at_s <= _until(one)
        for one in history.played
    )


def _attacked(history: History, frame: Frame, robot: str) -> bool:
    return any(
        one.fault.kind == "impostor"
        and one.fault.target == robot
        and one.begun_s <= frame.at_s <= _until(one) + 1.0
        for one in history.played
    )
