"""Plays a schedule: each fault begins at its time, ends at its time, and is waited for."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence

from deploy.progress import say
from research.chaos.faults.base import Kind
from research.chaos.faults.outsiders import is_thief
from research.chaos.history import Fault, Played
from research.chaos.stage import Stage
from research.chaos.watch import Watch
from swarm.errors import CoAdaptError

UP_S = 40.0
"""What is not there again so long after a fault's end stays away."""
POLL_S = 0.05


def play(
    stage: Stage, watch: Watch, faults: Sequence[Fault], kinds: Mapping[str, Kind], seconds: float
) -> tuple[Played, ...]:
    """What became of the faults, in their order. Lasts `seconds` at least."""
    played: dict[int, Played] = {}

    def one(number: int, fault: Fault) -> None:
        time.sleep(max(0.0, fault.at_s - watch.now_s()))
        played[number] = _play(stage, watch, fault, kinds[fault.kind])
        say(f"  {_line(played[number])}")

    threads = [
        threading.Thread(target=one, args=(number, fault), name=fault.kind)
        for number, fault in enumerate(faults)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    time.sleep(max(0.0, seconds - watch.now_s()))
    return tuple(played[number] for number in range(len(faults)))


def _play(stage: Stage, watch: Watch, fault: Fault, kind: Kind) -> Played:
    hits = _hits(stage, fault, kind)
    instance = watch.instance(fault.target)
    begun_s = watch.now_s()
    seen = error = ""
    try:
        end = kind.begin(stage, fault)
        time.sleep(max(0.0, begun_s + fault.lasts_s - watch.now_s()))
        seen = end()
    except (CoAdaptError, OSError) as problem:
        error = str(problem)
    ended_s = watch.now_s()
    up_s = None if error else _wait(watch, kind, fault, ended_s, instance)
    return Played(
        fault=fault,
        begun_s=begun_s,
        ended_s=ended_s,
        up_s=up_s,
        hits=hits,
        ego_down=kind.ego_down,
        seen=seen,
        error=error,
    )


def _hits(stage: Stage, fault: Fault, kind: Kind) -> tuple[str, ...]:
    """The robots that it may keep from taking part."""
    if kind.outside and stage.stolen is not None:
        # A thief may speak as the robot that was robbed, and as nobody else.
        return (
            (fault.target,) if fault.target == stage.stolen.name and is_thief(stage, fault) else ()
        )
    return {"nobody": (), "target": (fault.target,), "everybody": stage.robots}[kind.hits]


def _wait(
    watch: Watch, kind: Kind, fault: Fault, ended_s: float, instance: int | None
) -> float | None:
    while not watch.is_up(kind.sign, fault.target, ended_s, instance):
        if watch.now_s() > ended_s + UP_S:
            return None
        time.sleep(POLL_S)
    return watch.now_s()


def _line(played: Played) -> str:
    fault = played.fault
    what = f"{fault.kind} {fault.target}".strip()
    words = f"FAILED: {played.error}" if played.error else played.seen
    up = "not back" if played.up_s is None else f"back after {played.up_s - played.ended_s:.1f} s"
    return f"{played.begun_s:6.1f} s to {played.ended_s:6.1f} s  {what}: {words}; {up}"
