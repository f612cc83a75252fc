"""`build/chaos.json`: what a run did, and what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from research.chaos.history import History, Played
from research.chaos.invariants import Broken, during, gaps, hijacked, holes, lost_lines
from research.chaos.memory import slopes
from research.chaos.recovery import recovery


def report(
    history: History, found: Sequence[Broken], *, seed: int, replay: str, left_out: Sequence[str]
) -> dict[str, Any]:
    """All figures, and one row a fault. `left_out`: kinds that cannot be played here."""
    missed, down = gaps(history)
    unplayed = [one for one in history.played if one.error]
    rows = [_row(history, one) for one in history.played if not one.error]
    counted = [row["recovery_cycles"] for row in rows if row["recovery_cycles"] is not None]
    steepest = next(iter(slopes(history.memory)), None)
    return {
        "seed": seed,
        "replay": replay,
        "seconds": round(history.seconds, 1),
        "faults": len(rows),
        "kinds": len({row["kind"] for row in rows}),
        "unplayed": [f"{one.fault.kind} {one.fault.target}: {one.error}" for one in unplayed],
        "left_out": list(left_out),
        "cycles": len(history.cycles),
        "cycles_missed": sum(count for _, count in missed),
        "cycles_down": down,
        "recovery_cycles_max": max(counted, default=0),
        "not_recovered": sum(
            row["recovery_cycles"] is None and not row["disturbed"] for row in rows
        ),
        "journal_lost": sum(n for _, n in holes(history)) + len(lost_lines(history)),
        "hijacked": len(hijacked(history)),
        "ap_70": history.seen and round(history.seen.ap_70, 3),
        "ap_70_alone": history.seen and round(history.seen.ap_70_alone, 3),
        "frames_compared": history.seen and history.seen.frames,
        "frames": len(history.frames),
        "frame_age_ms_max": round(max((f.age_ms for f in history.frames), default=0.0), 1),
        "known_age_s_max": round(max((f.known_s for f in history.frames), default=0.0), 3),
        "rss_slope_mb_per_h": steepest.mb_per_h if steepest else None,
        "rss_slope_error_mb_per_h": steepest.error_mb_per_h if steepest else None,
        "rss": msgspec.to_builtins(slopes(history.memory)),
        "broken": [
            {**msgspec.to_builtins(one), "during": during(history, one.at_s)} for one in found
        ],
        "rows": rows,
    }


def write(path: Path, table: dict[str, Any]) -> None:
    """Writes it, in a folder that is made where it is not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(table)) + b"\n")


def _row(history: History, one: Played) -> dict[str, Any]:
    back = recovery(history, one)
    return {
        "kind": one.fault.kind,
        "target": one.fault.target,
        "begin_s": round(one.begun_s, 2),
        "end_s": round(one.ended_s, 2),
        "restart_s": None if one.up_s is None else round(one.up_s - one.ended_s, 2),
        "seen": one.seen,
        "recovery_cycles": back.cycles,
        "recovery_s": None if back.seconds is None else round(back.seconds, 2),
        "disturbed": back.disturbed,
    }
