"""The published results of CoAdapt, read again: what its own files say.

A folder a decision maker (a language model, or `rulebased`), in it a folder a data split, in that
`selection.csv` (decisions), `eval.csv` (what came of them) and `eval_baseline.csv` (everyone in
range, same cycles, same algorithm).
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from research.evaluation.bootstrap import Interval, bootstrap_mean
from swarm.errors import EvaluationError
from worlds.sample import data_folder

RATE_HZ = 10.0
"""Frames a second of OPV2V: every frame is fused."""
RULES = "rulebased"
FOLDER = Path("paper-results")
SELECTION_COLUMNS = (
    "scenario", "frame_idx", "frame_name", "ego_cav", "com_range_m", "bandwidth_mbps", "all_cavs",
    "in_range_cavs", "selected_cavs", "n_selected", "fusion_method", "reason",
    "llm_response_time_s",
)  # fmt: skip
EVAL_COLUMNS = (
    "scenario", "selection_frame", "n_frames_inferred", "fusion_method", "all_cavs",
    "in_range_cavs", "selected_cavs", "n_selected", "avg_ap_03", "avg_ap_05", "avg_ap_07",
    "total_comm_bytes", "avg_comm_bytes_per_frame",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one choice brought in one cycle."""

    algorithm: str
    robots: int
    """The ego included."""
    ap_30: float
    ap_50: float
    ap_70: float
    bytes_per_frame: float


@dataclass(frozen=True, slots=True)
class Cycle:
    """One published control cycle."""

    split: str
    scenario: str
    frame: str
    bandwidth_bps: float
    response_s: float
    """Of the language model; 0 of rules."""
    chosen: Outcome
    everyone: Outcome
    """The same algorithm with all vehicles in range."""

    @property
    def needs_bps(self) -> float:
        """bit/s that the choice takes at RATE_HZ."""
        return self.chosen.bytes_per_frame * 8 * RATE_HZ

    @property
    def infeasible(self) -> bool:
        """Whether that is more than the link had, by the file's own figures."""
        return self.needs_bps > self.bandwidth_bps


@dataclass(frozen=True, slots=True)
class Summary:
    """Means over all cycles of one decision maker."""

    name: str
    cycles: int
    ap_30: float
    ap_50: float
    ap_70: float
    bytes_per_frame: float
    everyone_ap_70: float
    everyone_bytes_per_frame: float
    saved: float
    """Share of the bytes of everyone that its choices save, both summed over the cycles."""
    paired_saved: float
    """Mean over the cycles of the share that each saves."""
    lost_ap_70: Interval
    """AP@0.7 of the choice less that of everyone, a cycle."""
    fewer: int
    """Cycles in which it left somebody out."""
    algorithms: dict[str, int]
    infeasible: int
    """Cycles whose choice the link could not have carried."""
    response_s: float


def read_published(folder: Path) -> dict[str, list[Cycle]]:
    """All cycles by decision maker. Raises EvaluationError for a folder or file that is not as
    described above, naming it and what is wrong."""
    if not folder.is_dir():
        raise EvaluationError(f"{folder} is not a folder")
    makers = {
        maker.name: [cycle for split in _folders(maker) for cycle in _cycles(split)]
        for maker in _folders(folder)
    }
    found = {name: cycles for name, cycles in makers.items() if cycles}
    if not found:
        raise EvaluationError(
            f"{folder} holds no published results: no */*/selection.csv beside an eval.csv"
        )
    return found


def found_published() -> dict[str, list[Cycle]]:
    """The published results in the data folder (worlds.sample); none where there are none."""
    folder = data_folder(FOLDER)
    return {} if folder is None else read_published(folder)


def summary(name: str, cycles: Sequence[Cycle]) -> Summary:
    """The means of one decision maker; there must be at least one cycle."""
    count = len(cycles)

    def mean(values: Iterator[float]) -> float:
        return sum(values) / count

    used = sum(cycle.chosen.bytes_per_frame for cycle in cycles)
    everyone = sum(cycle.everyone.bytes_per_frame for cycle in cycles)
    return Summary(
        name=name,
        cycles=count,
        ap_30=mean(cycle.chosen.ap_30 for cycle in cycles),
        ap_50=mean(cycle.chosen.ap_50 for cycle in cycles),
        ap_70=mean(cycle.chosen.ap_70 for cycle in cycles),
        bytes_per_frame=used / count,
        everyone_ap_70=mean(cycle.everyone.ap_70 for cycle in cycles),
        everyone_bytes_per_frame=everyone / count,
        saved=1 - used / everyone if everyone else 0.0,
        paired_saved=mean(_saved(cycle) for cycle in cycles),
        lost_ap_70=bootstrap_mean(
            [c.chosen.ap_70 - c.everyone.ap_70 for c in cycles], [c.scenario for c in cycles]
        ),
        fewer=sum(cycle.chosen.robots < cycle.everyone.robots for cycle in cycles),
        algorithms=dict(Counter(cycle.chosen.algorithm for cycle in cycles)),
        infeasible=sum(cycle.infeasible for cycle in cycles),
        response_s=mean(cycle.response_s for cycle in cycles),
    )


def _saved(cycle: Cycle) -> float:
    everyone = cycle.everyone.bytes_per_frame
    return 1 - cycle.chosen.bytes_per_frame / everyone if everyone else 0.0


def _folders(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_dir())


def _cycles(split: Path) -> Iterator[Cycle]:
    paths = [split / name for name in ("selection.csv", "eval.csv", "eval_baseline.csv")]
    if not paths[0].exists():
        return
    decisions, chosen, everyone = (
        {(row["scenario"], row[frame]): row for row in _rows(path, columns)}
        for path, columns, frame in zip(
            paths,
            (SELECTION_COLUMNS, EVAL_COLUMNS, EVAL_COLUMNS),
            ("frame_name", "selection_frame", "selection_frame"),
            strict=True,
        )
    )
    for key, row in decisions.items():
        for path, rows in ((paths[1], chosen), (paths[2], everyone)):
            if key not in rows:
                raise EvaluationError(f"{path} has no row for scenario {key[0]}, frame {key[1]}")
        yield Cycle(
            split=split.name,
            scenario=key[0],
            frame=key[1],
            bandwidth_bps=_number(paths[0], row, "bandwidth_mbps") * 1e6,
            response_s=_number(paths[0], row, "llm_response_time_s"),
            chosen=_outcome(paths[1], chosen[key]),
            everyone=_outcome(paths[2], everyone[key]),
        )


def _rows(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise EvaluationError(f"{path} cannot be read: {error}") from error
    for number, row in enumerate(rows, 2):
        missing = [name for name in columns if row.get(name) is None]
        if missing:
            raise EvaluationError(f"{path}, line {number}: no {missing[0]}")
    return rows


def _outcome(path: Path, row: dict[str, str]) -> Outcome:
    return Outcome(
        algorithm=row["fusion_method"],
        robots=int(_number(path, row, "n_selected")),
        ap_30=_number(path, row, "avg_ap_03"),
        ap_50=_number(path, row, "avg_ap_05"),
        ap_70=_number(path, row, "avg_ap_07"),
        bytes_per_frame=_number(path, row, "avg_comm_bytes_per_frame"),
    )


def _number(path: Path, row: dict[str, str], column: str) -> float:
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise EvaluationError(
            f"{path}: {column} of scenario {row['scenario']} is {row[column]!r}, not a number"
        )
    return value
