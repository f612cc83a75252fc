"""Twelve robots, all of them egos, in one cell: every ego asks each robot for itself, or robots
publish once for all who want the same.

Floors of the factory, window by window and without a network, for two cores do not carry twelve
live egos. `everybody`: all ask all others, 132 copies of a frame against 12. `chosen`: each ego
decides by `coverage` with its part of the cell. Both ways fuse the same participants of the same
frames, and all that was asked for arrives, also where the medium would not carry it: that favours
asking one by one.

Airtime is counted on one medium, up and down apart (`research.evaluation.airtime`), with the sizes
of the project's own messages. One by one: request and answer of each pair of robots pass the access
point, twice each. Published once: each frame goes up once, and down once to the group at the basic
rate `GROUP_BPS`; `rows` hold other rates, the access point that turns groups into unicasts, and a
floor with far stations. A live row counts what the kernel saw leave a robot that three egos want.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

from ego_agent.execute.shared import RENEWED_IN
from ego_agent.knowledge.objective import Objective
from perception.metrics import precision_of
from research.benchmarks.live import live_swarm, why_not
from research.benchmarks.report import write_report
from research.evaluation.airtime import Station, group_s, jain, station_of
from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.egos import Egos, Floor, Seen, WindowRequest
from research.evaluation.workers import each
from robot_agent.sharing import PROMISE_S
from swarm import keyspace
from swarm.listening import Handlers, listen
from swarm.messages import (
    Detections,
    NetState,
    Observation,
    ObservationRequest,
    ShapeReply,
    ShapeRequest,
    encode,
)
from swarm.session import Session

ROBOTS, RINGS, FLOORS, FRAMES, STEP = 12, 32, 6, 4, 12
CELL_BPS = 55e6
GROUP_BPS = 24e6
"""The highest rate that every station of 802.11a/g/n must hear: what sites with good coverage
set."""
GROUP_RATES_BPS = (6e6, 12e6, 24e6)
FAR = ((10.0, 1.0), (20.0, 0.8), (30.0, 0.6), (math.inf, 0.3))
"""Metres from the access point, and the part of the fastest rate that is left: MCS 7, 5, 4, 2."""
RATE_HZ = Objective().rate_hz
ZENOH_BYTES = 60
"""Of a message: key expression, identifiers, framing."""
BEACON_BYTES = 260
LIVE_HZ, LIVE_DEADLINE_S = 2.0, 0.45
"""Slow enough for all processes on two cores: frames that an ego skips would count as sent in vain.
"""
LIVE_ROBOTS, LIVE_S, SETTLE_S, WAIT_S = 4, 15.0, 8.0, 60.0

Rates = Callable[[str], Station]


@dataclass(frozen=True, slots=True)
class Airtime:
    """Of one frame period, seconds."""

    up_s: float
    """What stations send."""
    down_s: float
    """What the access point sends."""

    @property
    def all_s(self) -> float:
        """Of the medium, which carries one at a time."""
        return self.up_s + self.down_s


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame of one floor, all its egos together."""

    single: Airtime
    published: Airtime
    served_s: dict[str, float]
    """Airtime of what reached each ego that way, of all that it listens to."""


def request_bytes() -> int:
    """A request on the wire, with where the ego is."""
    here = (12.3, 4.5, 1.2, 0.0, 0.0, 0.7)
    asked = ObservationRequest(
        ego="R11", request=12345, algorithm="early", capture_ns=time.time_ns(), reference=here
    )
    return len(encode(asked)) + ZENOH_BYTES


def answer_bytes(payload: int) -> int:
    """An answer on the wire."""
    here = (12.3, 4.5, 1.2, 0.0, 0.0, 0.7)
    seen = Observation(
        robot="R11", instance=1 << 47, request=12345, algorithm="early",
        capture_ns=time.time_ns(), frame=123456, pose=here, payload=bytes(payload), encode_ms=7.7,
    )  # fmt: skip
    return len(encode(seen)) + ZENOH_BYTES


def airtime(
    asked: Mapping[str, WindowRequest],
    seen: Mapping[str, Seen],
    rate: Rates,
    group_bps: float | None,
) -> Frame:
    """Both ways of one frame; `group_bps` None: the access point sends each listener its copy."""
    ask, reply = request_bytes(), answer_bytes(0)
    up = down = 0.0
    for ego, one in seen.items():
        for robot, size in one.single_bytes.items():
            up += rate(ego).unicast_s(ask) + rate(robot).unicast_s(answer_bytes(size))
            down += rate(robot).unicast_s(ask) + rate(ego).unicast_s(answer_bytes(size))
    wanted: dict[tuple[str, str], list[str]] = {}
    for ego, wish in asked.items():
        for robot in wish.participants:
            wanted.setdefault((robot, wish.algorithm), []).append(ego)
    once_up = once_down = 0.0
    served = dict.fromkeys(asked, 0.0)
    for (robot, _), egos in wanted.items():
        size = answer_bytes(seen[egos[0]].shared_bytes[robot])
        up_s = rate(robot).unicast_s(size)
        copies = [rate(ego).unicast_s(size) for ego in egos]
        # A group of one is a station.
        group = sum(copies) if group_bps is None or len(egos) == 1 else group_s(size, group_bps)
        once_up += up_s
        once_down += group
        for ego in egos:
            served[ego] += up_s + group
            renewals = 1.0 / (RATE_HZ * RENEWED_IN * PROMISE_S)
            once_up += renewals * (rate(ego).unicast_s(ask) + rate(robot).unicast_s(reply))
            once_down += renewals * (rate(robot).unicast_s(ask) + rate(ego).unicast_s(reply))
    return Frame(Airtime(up, down), Airtime(once_up, once_down), served)


def control_s(robots: Sequence[str], rate: Rates) -> float:
    """Airtime of all beacons in a frame period: up one by one, and down to each ego together."""
    up = sum(rate(robot).unicast_s(BEACON_BYTES) for robot in robots)
    return up + sum(rate(robot).unicast_s(BEACON_BYTES * (len(robots) - 1)) for robot in robots)


def rates_of(egos: Egos, frame: int, *, far: bool) -> Rates:
    """Each station's rate; near ones all have the cell's."""
    near = station_of(CELL_BPS)
    if not far:
        return lambda robot: near
    poses = {robot: egos.world.pose(robot, frame) for robot in egos.world.robots}
    middle = [fmean(p.x for p in poses.values()), fmean(p.y for p in poses.values())]

    def rate(robot: str) -> Station:
        away_m = math.hypot(poses[robot].x - middle[0], poses[robot].y - middle[1])
        return Station(near.rate_bps * next(part for reach_m, part in FAR if away_m < reach_m))

    return rate


def floor_rows(seed: int) -> list[dict[str, Any]]:
    """One floor: by case, what it saw and what it took."""
    first = 100 + 400 * seed
    frames = tuple(first + STEP * at for at in range(FRAMES))
    egos = Egos(Floor(seed, ROBOTS, RINGS, frames))
    robots = egos.world.robots
    # Up and down are one medium: what an ego asks for passes it twice.
    chosen = egos.decisions(CELL_BPS / len(robots) / 2.0)
    rows = []
    for case, asked in (("everybody", egos.everybody("early")), ("chosen", chosen)):
        seen = [egos.frame(frame, asked) for frame in frames]
        row: dict[str, Any] = {
            "floor": seed,
            "case": case,
            "pairs": sum(len(one.participants) for one in asked.values()),
            "unfit": sum(not one.fits for one in asked.values()),
            "ap_single": precision_of([s.alone for f in seen for s in f.values()]),
            "ap_shared": precision_of([s.shared for f in seen for s in f.values()]),
            "ego_ap": {e: precision_of([f[e].shared for f in seen]) for e in robots},
            "ego_ap_single": {e: precision_of([f[e].alone for f in seen]) for e in robots},
            "single_bytes": fmean(
                sum(size for s in f.values() for size in s.single_bytes.values()) for f in seen
            ),
        }
        for name, group_bps, far in (
            *((f"group {bps / 1e6:g} Mbit/s", bps, False) for bps in GROUP_RATES_BPS),
            ("a copy each", None, False),
            ("far stations", GROUP_BPS, True),
        ):
            counted = [
                airtime(asked, f, rates_of(egos, frame, far=far), group_bps)
                for frame, f in zip(frames, seen, strict=True)
            ]
            row[name] = {
                "single_up_s": fmean(c.single.up_s for c in counted),
                "single_down_s": fmean(c.single.down_s for c in counted),
                "up_s": fmean(c.published.up_s for c in counted),
                "down_s": fmean(c.published.down_s for c in counted),
                "longest_s": max(c.published.all_s for c in counted)
                + control_s(robots, rates_of(egos, frames[0], far=far)),
                "served_s": {e: fmean(c.served_s[e] for c in counted) for e in robots},
            }
        rows.append(row)
    return rows


def table(rows: Sequence[dict[str, Any]], case: str, name: str) -> dict[str, Any]:
    """What one way of sending takes, means over the floors, milliseconds a frame."""
    found = [row[name] for row in rows if row["case"] == case]
    parts = {k: 1e3 * fmean(one[k] for one in found) for k in found[0] if k != "served_s"}
    single = parts["single_up_s"] + parts["single_down_s"]
    published = parts["up_s"] + parts["down_s"]
    return {
        "case": case,
        "sent": name,
        "one_by_one_up_ms": round(parts["single_up_s"], 1),
        "one_by_one_down_ms": round(parts["single_down_s"], 1),
        "published_up_ms": round(parts["up_s"], 1),
        "published_down_ms": round(parts["down_s"], 1),
        "ratio": round(published / single, 3),
        "floors_too_slow": sum(one["longest_s"] * RATE_HZ > 1.0 for one in found),
    }


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of all floors."""
    usual = f"group {GROUP_BPS / 1e6:g} Mbit/s"
    names = [
        name for name in rows[0] if isinstance(rows[0][name], dict) and "up_s" in rows[0][name]
    ]
    tables = [table(rows, case, name) for case in ("everybody", "chosen") for name in names]
    result: dict[str, Any] = {}
    for case, tail in (("everybody", ""), ("chosen", "_chosen")):
        of = [row for row in rows if row["case"] == case]
        (sent,) = [one for one in tables if (one["case"], one["sent"]) == (case, usual)]
        gain = bootstrap_mean([r["ap_shared"] - r["ap_single"] for r in of])
        result |= {
            f"bytes_ratio{tail}": sent["ratio"],
            f"delivered_difference{tail}": round(gain.mean, 4),
            f"delivered_difference_interval{tail}": [round(gain.low, 4), round(gain.high, 4)],
            f"ap_70{tail}": round(fmean(r["ap_shared"] for r in of), 4),
            f"ap_70_one_by_one{tail}": round(fmean(r["ap_single"] for r in of), 4),
            f"worst_ego_ap_70{tail}": round(min(min(r["ego_ap"].values()) for r in of), 4),
            f"worst_ego_ap_70_one_by_one{tail}": round(
                min(min(r["ego_ap_single"].values()) for r in of), 4
            ),
            f"infeasible{tail}": sum(r["unfit"] for r in of) + sent["floors_too_slow"],
            f"jain{tail}": round(fmean(jain(_weighted(r, usual)) for r in of), 4),
            f"jain_of_ap{tail}": round(fmean(jain(list(r["ego_ap"].values())) for r in of), 4),
            f"pairs{tail}": round(fmean(r["pairs"] for r in of), 1),
        }
    return result | {"rows": tables}


def _weighted(row: dict[str, Any], sent: str) -> list[float]:
    """Airtime of what reached each ego, by its AP."""
    return [row["ego_ap"][ego] * s for ego, s in row[sent]["served_s"].items()]


def live(share: bool) -> dict[str, Any]:
    """Three egos that all want the fourth robot: what its kernel saw leave, and what each ego
    fused."""
    egos = tuple(f"R{at}" for at in range(1, LIVE_ROBOTS))
    wanted = f"R{LIVE_ROBOTS}"
    settings = {
        "COADAPT_SHARE": str(share).lower(),
        "COADAPT_FUSION_RATE_HZ": str(LIVE_HZ),
        "COADAPT_DEADLINE_S": str(LIVE_DEADLINE_S),
    }
    robots = tuple(f"R{at}" for at in range(1, LIVE_ROBOTS + 1))
    values = {"robots": robots, "egos": egos, "policy": "static-early", "rings": 16}
    with live_swarm("bench-egos", settings, **values) as state:
        with Session(state.router, state.spec.swarm, timeout_s=WAIT_S) as session:
            request = ShapeRequest(
                profile="rate", robot=wanted, direction="up", rate_bps=int(CELL_BPS)
            )
            key = keyspace.net_shape(session.swarm)
            session.ask(key, request, ShapeReply, timeout_s=WAIT_S).result()
        heard: list[tuple[float, int]] = []
        frames: list[Detections] = []

        def on_links(state: NetState) -> None:
            link = state.link(wanted, "up")
            if link is not None:
                heard.append((time.monotonic(), link.classes["fusion"].sent_bytes))

        time.sleep(SETTLE_S)
        begun = time.monotonic()
        handlers: Handlers = {NetState: on_links, Detections: frames.append}
        session = listen(state.router, state.spec.swarm, handlers, timeout_s=WAIT_S)
        time.sleep(LIVE_S)
        session.close()
        elapsed_s = time.monotonic() - begun
    (first_at, first), (last_at, last) = heard[0], heard[-1]
    in_it = [one for one in frames if wanted in one.participants]
    return {
        "share": share,
        "egos": len(egos),
        "up_bytes_s": round((last - first) / (last_at - first_at)),
        "frames_per_s": round(len(frames) / len(egos) / elapsed_s, 2),
        "in_time_ratio": round(len(in_it) / max(1, len(frames)), 3),
        "up_bytes_a_fused_frame": round(
            (last - first) / (last_at - first_at) / max(0.1, len(in_it) / elapsed_s)
        ),
    }


def main() -> None:
    """Writes build/bench/egos.json."""
    rows = [
        row
        for _, found in sorted(each(floor_rows, range(FLOORS), os.cpu_count() or 1, "factory"))
        for row in found
    ]
    result = {"egos": ROBOTS, "cell_bps": CELL_BPS, "group_bps": GROUP_BPS, **figures(rows)}
    why = why_not()
    if why is None:
        both = [live(share) for share in (False, True)]
        alone, shared = (one["up_bytes_a_fused_frame"] for one in both)
        result |= {"live": both, "live_up_ratio": round(shared / alone, 3)}
    else:
        result["live_skipped"] = why
    samples = [{k: v for k, v in row.items() if k != "served_s"} for row in rows]
    path = write_report("egos", result, {"floors": samples, "near": asdict(station_of(CELL_BPS))})
    print(path)


if __name__ == "__main__":
    main()
