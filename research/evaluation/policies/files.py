"""The files of a comparison: selection.csv and eval.csv with the published columns, headline.json.

Columns that CoAdapt publishes come first, under its names; ours follow.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from ego_agent.knowledge.compute import ComputeModel
from research.evaluation.machine import machine_facts
from research.evaluation.policies.beside import LLM
from research.evaluation.policies.results import Means, Row
from research.evaluation.published import EVAL_COLUMNS, SELECTION_COLUMNS
from swarm.files import write_whole

OWN_SELECTION = (
    "policy", "window", "source", "predicted_bytes", "decision_ms", "link", "pose_noise_m",
    "repairs",
)  # fmt: skip
OWN_EVAL = (
    "policy", "window", "value", "regret", "held_out_regret", "infeasible", "ground_truth",
    "delivered_ap_07", "ego_ms_per_frame", "in_time_ratio",
)  # fmt: skip


def write_selection(path: Path, rows: Sequence[Row]) -> None:
    """Who was selected, by whom and why."""
    _write(
        path,
        (*SELECTION_COLUMNS, *OWN_SELECTION),
        [
            {
                **_common(row),
                "frame_idx": row.scenario.decision_frame(row.decided.window),
                "frame_name": f"{row.scenario.decision_frame(row.decided.window):06d}",
                "ego_cav": row.decided.ego,
                "com_range_m": row.scenario.comm_range_m,
                "bandwidth_mbps": round(row.capacity_bps / 1e6, 4),
                "reason": row.decided.reason,
                "llm_response_time_s": round(_answer_s(row), 3),
                "policy": row.decided.policy,
                "window": row.decided.window,
                "source": row.decided.source,
                "predicted_bytes": row.decided.predicted_bytes,
                "decision_ms": round(1e3 * row.decided.decision_s, 3),
                "link": row.scenario.link.name,
                "pose_noise_m": row.scenario.pose_noise_m,
                "repairs": " ".join(row.decided.repairs),
            }
            for row in rows
        ],
    )


def write_eval(path: Path, rows: Sequence[Row]) -> None:
    """What the selections brought."""
    _write(
        path,
        (*EVAL_COLUMNS, *OWN_EVAL),
        [
            {
                **_common(row),
                "selection_frame": f"{row.scenario.decision_frame(row.decided.window):06d}",
                "n_frames_inferred": row.outcome.frames,
                "avg_ap_03": round(row.outcome.ap_30, 4),
                "avg_ap_05": round(row.outcome.ap_50, 4),
                "avg_ap_07": round(row.outcome.ap_70, 4),
                "total_comm_bytes": round(row.outcome.bytes_per_frame * row.outcome.frames),
                "avg_comm_bytes_per_frame": round(row.outcome.bytes_per_frame, 1),
                "policy": row.decided.policy,
                "window": row.decided.window,
                "value": round(row.value, 4),
                "regret": round(row.regret, 4),
                "held_out_regret": _rounded(row.held_out_regret),
                "infeasible": int(row.infeasible),
                "ground_truth": row.outcome.ground_truth,
                "delivered_ap_07": round(row.delivered_ap_70, 4),
                "ego_ms_per_frame": round(row.outcome.arrived.ego_ms_per_frame, 2),
                "in_time_ratio": round(row.outcome.arrived.in_time_ratio, 4),
            }
            for row in rows
        ],
    )


def write_headline(path: Path, means: Sequence[Means], more: Mapping[str, Any]) -> None:
    """The means as JSON, with the machine's facts and whatever else is given."""
    report = {"rows": [asdict(one) for one in means], **more, "machine": machine_facts()}
    write_whole(path, json.dumps(_plain(report), indent=1) + "\n")


def write_compute(path: Path, model: ComputeModel) -> None:
    """The model of compute that windows were played with."""
    write_whole(path, json.dumps(msgspec.to_builtins(model), indent=1) + "\n")


def _common(row: Row) -> dict[str, Any]:
    """Columns that both files share."""
    decided = row.decided
    return {
        "scenario": row.scenario.name,
        "fusion_method": decided.choice.algorithm or "none",
        "all_cavs": "|".join(decided.robots),
        "in_range_cavs": "|".join((decided.ego, *decided.in_range)),
        "selected_cavs": "|".join((decided.ego, *decided.choice.participants)),
        "n_selected": 1 + len(decided.choice.participants),
    }


def _answer_s(row: Row) -> float:
    """What the published column means: 0 where no language model was asked."""
    return row.decided.decision_s if row.decided.policy.startswith(LLM) else 0.0


def _write(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue())


def _rounded(value: float | None) -> float | str:
    return "" if value is None else round(value, 4)


def _plain(value: Any) -> Any:
    """Rounded, and None for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return round(value, 5) if math.isfinite(value) else None
    return value
