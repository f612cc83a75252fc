"""Links so narrow that beacons alone could fill them: is anything stale taken for fresh?

Swarms of 4, 6 and 12 robots in network namespaces, the cell to the ego shaped to 64 kbit/s up to
1 Mbit/s, one after the other, while everything else is as `make up` has it. Listens at the router,
which the narrow link is not before, and reads the ego's journal. All processes share one clock, so
that every clock offset is 0 in truth, and the true age of what the ego holds of a robot is what it
claims less the offset that it believes in. A fused frame that is older than a second counts as
stale, also where it says so itself (`old_frames`: the machine is too slow).

`quality` is what decisions predict, on average, with 0 for those that know of none.

A row takes `--seconds` (the default keeps `make bench` short; 120 is what was asked for).
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deploy.paths import journal_path
from deploy.spec import factory_robots
from deploy.state import State
from research.benchmarks.live import live_swarm, why_not
from research.benchmarks.report import write_report
from swarm import keyspace
from swarm.listening import Handlers, listen
from swarm.messages import Decision, Detections, ShapeReply, ShapeRequest
from swarm.session import Session

ROBOTS = (4, 6, 12)
RATES_BPS = (1_000_000, 500_000, 300_000, 100_000, 64_000)
SECONDS = 25.0
SETTLE_S = 8.0
"""Choices may change so soon after the link did; staleness and silence count from the start."""
STALE_S = 1.0
ENOUGH = 3
"""Robots, the ego among them, of whom a frame that counts as delivered has boxes or more."""
RECENT_S = 1.25
"""So long what a robot showed is in a frame, as memory carries it on: once a second, and within the
deadline."""
CONNECT_S = 10.0


@dataclass(slots=True)
class EgoPublications:
    """What the ego published, with the steady time at which it came; Zenoh's threads write."""

    decisions: list[tuple[float, Decision]] = field(default_factory=list)
    frames: list[tuple[float, Detections, float]] = field(default_factory=list)
    """With the age of what was fused."""
    lock: threading.Lock = field(default_factory=threading.Lock)

    def on_decision(self, decision: Decision) -> None:
        """A cycle was decided."""
        with self.lock:
            self.decisions.append((time.monotonic(), decision))

    def on_frame(self, frame: Detections) -> None:
        """A frame was fused."""
        age_s = (time.time_ns() - frame.capture_ns) * 1e-9
        with self.lock:
            self.frames.append((time.monotonic(), frame, age_s))


def row(
    state: State, session: Session, published: EgoPublications, rate_bps: int, seconds: float
) -> Any:
    """One rate on a swarm that runs."""
    key = keyspace.net_shape(session.swarm)
    request = ShapeRequest(profile="rate", rate_bps=rate_bps, operator="narrow")
    session.ask(key, request, ShapeReply, timeout_s=CONNECT_S).result()
    begun, begun_ns = time.monotonic(), time.time_ns()
    time.sleep(seconds)
    with published.lock:
        decisions = [one for one in published.decisions if one[0] >= begun]
        frames = [one for one in published.frames if one[0] >= begun]
    cycles = [line for line in _journal(state) if line["started_ns"] >= begun_ns]
    stale = sum(_stale(line) for line in cycles)
    old = sum(len(f.participants) > 1 and age_s > STALE_S for _, f, age_s in frames)
    offsets = [abs(r["clock_offset_s"]) for line in cycles for r in _others(line).values()]
    settled = [d for at, d in decisions if at - begun >= SETTLE_S]
    choices = [(frozenset(d.participants), d.algorithm) for d in settled]
    changes = sum(one != other for one, other in itertools.pairwise(choices))
    late = [f for at, f, _ in frames if at - begun >= SETTLE_S]
    delivered = _shown([(at, f.participants) for at, f, _ in frames], begun + SETTLE_S)
    blind = [d.blind for d in settled]
    return {
        "robots": len(state.spec.robots),
        "rate_bps": rate_bps,
        "seconds": round(time.monotonic() - begun, 1),
        "stale_as_fresh": stale + old,
        "old_frames": old,
        "offset_error_ms_max": round(1e3 * max(offsets, default=0.0), 1),
        "silent_blind_s": round(_silent_blind_s(begun, decisions, frames), 2),
        "changes_per_min": round(60.0 * changes / max(1e-3, seconds - SETTLE_S), 2),
        "delivered_ratio": round(sum(n >= ENOUGH for n in delivered) / max(1, len(delivered)), 3),
        "robots_shown": round(sum(delivered) / max(1, len(delivered)), 2),
        "blind_ratio": round(sum(map(bool, blind)) / max(1, len(blind)), 3),
        "frames_per_s": round(len(late) / max(1e-3, seconds - SETTLE_S), 2),
        "quality": round(sum(d.quality for d in settled) / max(1, len(settled)), 3),
        "participants": round(sum(len(d.participants) for d in settled) / max(1, len(settled)), 2),
        "age_s_max_of_candidates": round(max(map(_oldest_s, cycles), default=0.0), 2),
        "algorithms": sorted({d.algorithm for d in settled}),
        "last_reason": decisions[-1][1].reason if decisions else "",
        "last_excluded": dict(decisions[-1][1].excluded) if decisions else {},
    }


def _shown(frames: list[tuple[float, tuple[str, ...]]], since: float) -> list[int]:
    """Of each frame since a time: how many robots have contributed to it, or RECENT_S before."""
    last: dict[str, float] = {}
    counts = []
    for at, participants in frames:
        last.update(dict.fromkeys(participants, at))
        if at >= since:
            counts.append(sum(at - then <= RECENT_S for then in last.values()))
    return counts


def _silent_blind_s(
    begun: float,
    decisions: list[tuple[float, Decision]],
    frames: list[tuple[float, Detections, float]],
) -> float:
    """The longest time in which nothing of other robots arrived while nothing said so: the newest
    decision took others in, and was not blind."""
    events = [(at, None if d.blind or len(d.participants) == 1 else True) for at, d in decisions]
    events += [(at, False) for at, f, _ in frames if len(f.participants) > 1]
    longest, well, said = 0.0, begun, False
    for at, what in sorted(events, key=lambda event: event[0]):
        if not said:
            longest = max(longest, at - well)
        if what is None:
            said, well = True, at
        elif what:
            well = at if said else well
            said = False
        else:
            well = at
    return longest


def _journal(state: State) -> Iterator[dict[str, Any]]:
    for line in Path(journal_path(state.spec, state.spec.var_dir)).read_text().splitlines():
        if line.endswith("}"):
            yield json.loads(line)


def _others(line: dict[str, Any]) -> dict[str, Any]:
    """Living robots but the ego of which a beacon has come, by id."""
    return {
        robot: known
        for robot, known in line["inputs"]["robots"].items()
        if robot != line["ego"] and known["alive"] and known["beacon_age_s"] is not None
    }


def _true_ages_s(line: dict[str, Any]) -> list[float]:
    """Of the robots that the ego takes for fresh."""
    excluded = line["inputs"]["excluded"]
    return [
        known["beacon_age_s"] - known["clock_offset_s"]
        for robot, known in _others(line).items()
        if robot not in excluded
    ]


def _stale(line: dict[str, Any]) -> int:
    return sum(age_s > STALE_S for age_s in _true_ages_s(line))


def _oldest_s(line: dict[str, Any]) -> float:
    return max(_true_ages_s(line), default=0.0)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The worst of all rows, and what six robots deliver at 300 kbit/s."""
    worst = {
        key: max(row[key] for row in rows)
        for key in ("offset_error_ms_max", "silent_blind_s", "changes_per_min")
    }
    asked = [r["delivered_ratio"] for r in rows if (r["robots"], r["rate_bps"]) == (6, 300_000)]
    return {
        "stale_as_fresh": sum(row["stale_as_fresh"] for row in rows),
        **worst,
        "delivered_ratio": asked[0] if asked else None,
    }


def main() -> None:
    """Runs the benchmark and writes build/bench/narrow.json."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of a row")
    parser.add_argument("--robots", type=int, nargs="+", default=ROBOTS)
    parser.add_argument("--rates", type=int, nargs="+", default=RATES_BPS, help="bit/s")
    args = parser.parse_args()
    if missing := why_not():
        raise SystemExit(f"narrow: {missing}")
    rows = []
    for robots in args.robots:
        with live_swarm(f"narrow{robots}", {}, robots=factory_robots(robots)) as state:
            published = EgoPublications()
            handlers: Handlers = {Decision: published.on_decision, Detections: published.on_frame}
            with listen(
                state.router, state.spec.swarm, handlers, state.spec.ego, timeout_s=CONNECT_S
            ) as session:
                for rate_bps in args.rates:
                    rows.append(row(state, session, published, rate_bps, args.seconds))
                    print(f"narrow: {rows[-1]}", file=sys.stderr)
    figures = summary(rows)
    path = write_report("narrow", {**figures, "seconds_a_row": args.seconds, "rows": rows}, {})
    print(f"{path}: {figures}")


if __name__ == "__main__":
    main()
