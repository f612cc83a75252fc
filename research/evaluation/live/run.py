"""`make eval LIVE=1`: a few scenarios through a real swarm, every policy in turn."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ego_agent.knowledge.compute import ComputeModel
from perception.fusion.registry import fusion_names
from research.evaluation.live.compare import LiveRow, compare_live
from research.evaluation.live.played import this_machine
from research.evaluation.live.swarm import record
from research.evaluation.machine import machine_facts
from research.evaluation.policies.decide import policy_of
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.tables import markdown
from research.evaluation.windows.scenarios import Scenario, factory_suite
from swarm.errors import EvaluationError
from swarm.files import write_whole

ROBOTS = (3, 4)
"""Of the scenarios that run live: as many as two cores can carry at the sensors' rate."""
LINKS_BPS = (20_000_000, 5_000_000)
"""The paper's medium and low tier."""
MAX_AP_OFF = 0.01
MAX_BYTES_OFF = 0.02
MAX_DELIVERED_OFF = 0.02


def live_suite() -> list[Scenario]:
    """A floor of each size in ROBOTS without pose noise."""
    clean = [s for s in factory_suite() if s.kind == "floor" and not s.pose_noise_m]
    return [next(s for s in clean if s.robots == robots) for robots in ROBOTS]


def run_live(
    scenarios: Sequence[Scenario],
    policies: Sequence[str],
    seconds: float,
    runtime: str,
    folder: Path,
    compute: ComputeModel | None = None,
) -> list[LiveRow]:
    """Runs every policy in every scenario on every link and writes live.json and live.md.

    `compute`: what windows are played with beside them, by default the packaged model.

    Raises DecisionError for an unknown policy, DeployError where no swarm can run, EvaluationError
    where there is nothing to run.
    """
    cases = [(s, link, p) for s in scenarios for link in LINKS_BPS for p in policies]
    if not cases:
        raise EvaluationError("there is nothing to run: no scenario, or no policy")
    for policy in policies:
        policy_of(policy, scenarios[0], knowledge_of(fusion_names("factory"), scenarios[0]))
    folder.mkdir(parents=True, exist_ok=True)
    machine = this_machine(compute)
    rows: list[LiveRow] = []
    for number, (scenario, link_bps, policy) in enumerate(cases, 1):
        recorded = record(scenario, policy, link_bps, seconds, runtime, folder)
        rows.append(compare_live(scenario, policy, link_bps, recorded, machine))
        print(f"live: {number}/{len(cases)}: {_words(rows[-1])}", file=sys.stderr, flush=True)
        _write(folder / "live.json", rows)
    write_whole(folder / "live.md", table(rows) + "\n")
    print(f"wrote live.json and live.md to {folder}", file=sys.stderr)
    return rows


def agreement(rows: Sequence[LiveRow]) -> dict[str, Any]:
    """The largest differences between what was delivered and the experiment."""
    known = [row for row in rows if row.frames_compared]
    ap_off = max((abs(_both(r.ap_70_live, r.ap_70_offline)) for r in known), default=None)
    bytes_off = max(
        (abs(_both(r.bytes_live, r.bytes_offline)) / (r.bytes_offline or 1.0) for r in known),
        default=None,
    )
    played = [row.played for row in rows if row.played.frames]
    delivered_off = max(
        (abs(_both(one.ap_70_live, one.ap_70_played)) for one in played), default=None
    )
    return {
        "ap_70_off_max": ap_off,
        "ap_70_agrees": ap_off is not None and ap_off <= MAX_AP_OFF,
        "bytes_off_max": bytes_off,
        "bytes_agree": bytes_off is not None and bytes_off <= MAX_BYTES_OFF,
        "delivered_ap_70_off_max": delivered_off,
        "delivered_ap_70_agrees": delivered_off is not None and delivered_off <= MAX_DELIVERED_OFF,
    }


def table(rows: Sequence[LiveRow]) -> str:
    """A line a run."""
    return markdown(
        (
            "scenario", "link Mbit/s", "policy", "delivered", "latency ms p50", "p99",
            "AP@0.7 live", "offline", "kB/frame live", "offline ", "frames compared",
            "delivered AP@0.7 live", "played", "told", "in time live", "played ", "fused live",
            "played  ", "latency ms p50 played",
        ),
        [
            (
                row.scenario, f"{row.link_bps / 1e6:g}", row.policy, f"{row.delivered_ratio:.0%}",
                _number(row.latency_ms_p50, 0), _number(row.latency_ms_p99, 0),
                _number(row.ap_70_live, 3), _number(row.ap_70_offline, 3),
                _number(row.bytes_live, 2, 1e3), _number(row.bytes_offline, 2, 1e3),
                row.frames_compared,
                _number(row.played.ap_70_live, 3), _number(row.played.ap_70_played, 3),
                _number(row.ap_70_told, 3),
                _percent(row.played.in_time_live), _percent(row.played.in_time_played),
                _percent(row.played.fused_live), _percent(row.played.fused_played),
                _number(row.played.latency_ms_p50_played, 0),
            )
            for row in rows
        ],
    )  # fmt: skip


def _both(live: float | None, offline: float | None) -> float:
    return (live or 0.0) - (offline or 0.0)


def _number(value: float | None, digits: int, unit: float = 1.0) -> str:
    return "" if value is None else f"{value / unit:.{digits}f}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.0%}"


def _words(row: LiveRow) -> str:
    return (
        f"{row.scenario}, {row.policy}, {row.link_bps / 1e6:g} Mbit/s: {row.frames_complete} of "
        f"{row.frames_due} frames complete, AP@0.7 {_number(row.ap_70_live, 3)} "
        f"(offline {_number(row.ap_70_offline, 3)}), of all frames "
        f"{_number(row.played.ap_70_live, 3)} (played {_number(row.played.ap_70_played, 3)})"
    )


def _write(path: Path, rows: Sequence[LiveRow]) -> None:
    report = {
        "rows": [asdict(row) for row in rows],
        **agreement(rows),
        "machine": machine_facts(),
    }
    write_whole(path, json.dumps(report, indent=1) + "\n")
