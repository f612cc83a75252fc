"""Policies as an ego runs them: decided every second, with memory, over the link's seconds.

The comparison of policies (evaluation/policies) holds a choice for a window and judges each frame
by itself. Here the ego remembers objects and poses, may ask robots less often where the policy may,
and decides anew each second; what comes in time is played. One window of each scenario is driven.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.machine import machine_facts
from research.evaluation.result_store import ResultStore
from research.evaluation.tables import markdown
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.measure import SETTLED_FRAMES, Measured, measure
from research.evaluation.ways.planned import GUESSED, RANDOM, TRAINED, Decided
from research.evaluation.ways.sampling import BETWEEN_HZ
from research.evaluation.ways.way import Way
from research.evaluation.windows.links import WINDOW_S
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.workers import each
from swarm.errors import EvaluationError
from swarm.files import write_whole

DEFAULT, EVERYONE, SINGLE_RATE = "coverage", "static-early", "coverage at 10 Hz"
PLAIN = "coverage, no places asked about"
UNHEEDED = "coverage, who cannot be placed is asked all the same"
NO_MEMORY = ", objects not remembered"
RULES = {
    f"everybody {sends} {hz:g} Hz, places {BETWEEN_HZ['factory'][hz]:g} Hz": (
        hz,
        sends == "objects",
    )
    for sends, hz in (("whole", 1.0), ("whole", 2.0), ("objects", 2.0), ("objects", 5.0))
}
"""The simplest that ask about places, too: the same of all, whatever the link; their rates, and
whether they send only what may be an object."""
CONTROLS = (EVERYONE, EVERYONE + NO_MEMORY, SINGLE_RATE, PLAIN, UNHEEDED, *RULES, RANDOM)
MADE_FROM = (
    "ego_agent", "network_controller", "perception", "research/evaluation", "sensing", "swarm",
    "worlds",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Policy:
    """How it is decided, and whether the ego remembers."""

    name: str
    decided: Decided | None
    """None: always the same is asked for."""
    memory: bool = True
    forms: tuple[tuple[str, float], ...] = ()
    """What always is, as in `Way`."""
    places_hz: float = 0.0
    objects_only: bool = False


POLICIES = (
    Policy(DEFAULT, Decided("coverage", rarer=True)),
    Policy(PLAIN, Decided("coverage", rarer=True, places=False)),
    Policy(UNHEEDED, Decided("coverage", rarer=True, learns=False)),
    Policy(SINGLE_RATE, Decided("coverage")),
    Policy(SINGLE_RATE + NO_MEMORY, Decided("coverage"), memory=False),
    Policy(EVERYONE, Decided(EVERYONE, validated=False)),
    Policy(EVERYONE + NO_MEMORY, Decided(EVERYONE, validated=False), memory=False),
    Policy("static-late", Decided("static-late", validated=False)),
    Policy("rules", Decided("rules", validated=False)),
    *(
        Policy(
            name,
            None,
            forms=(("early", hz),),
            places_hz=BETWEEN_HZ["factory"][hz],
            objects_only=objects_only,
        )
        for name, (hz, objects_only) in RULES.items()
    ),
    Policy(RANDOM, Decided(RANDOM, rarer=True)),
    Policy("nobody", None),
)
ADVISED = (
    Policy(TRAINED, Decided(TRAINED, rarer=True)),
    Policy(GUESSED, Decided(GUESSED, rarer=True)),
)
"""Driven beside these where they are asked for: a model takes its time."""


@dataclass(frozen=True, slots=True)
class Brought:
    """What one policy brought on one drive; of fused frames, where nothing else is said."""

    ap_50: float
    ap_70: float
    ap_70_with_known: float
    """Of the robots of which beacons tell, too."""
    ground_truth: int
    false_per_frame: float
    bytes_per_frame: float
    """That robots sent, in time or not, for each frame of the drive."""
    participants: float
    """The ego included."""
    ego_ms_per_frame: float
    """By the model of compute."""
    in_time_ratio: float
    fused_ratio: float
    """Of the drive's frames."""
    infeasible: float
    """1 where more was asked for than the link carries."""
    mota: float


@dataclass(frozen=True, slots=True)
class _Item:
    scenario: Scenario
    window: int
    policies: tuple[Policy, ...]

    def key(self) -> str:
        """By which the result is kept."""
        one = self.scenario
        frames = f"{one.decision_frame(self.window)}+{one.window_frames}"
        return f"driven {one.setting()} {self.window} {frames} {one.link} {self.policies}"


def compare(
    suite: Sequence[Scenario], workers: int, folder: Path, *, advised: bool = False
) -> dict[str, Any]:
    """Drives every policy on one window of each generated scenario; writes driven.json and
    driven.md into the folder and returns the figures. What is finished is kept in the folder, for a
    run that goes on after this one was ended. `advised`: with the embedded model and its control.

    Raises EvaluationError where no scenario holds a true box, and when a process ends before its
    work is done.
    """
    made_from = (*MADE_FROM, "llm_gateway") if advised else MADE_FROM
    kept = ResultStore(folder / "kept", made_from)
    policies = POLICIES + (ADVISED if advised else ())
    items = [_Item(one, one.seed % one.windows, policies) for one in suite]
    # Large swarms take longest: begun first, they do not keep one core busy at the end.
    items.sort(key=lambda item: -item.scenario.robots)
    found = [kept.get(item.key()) for item in items]
    missing = [at for at, one in enumerate(found) if one is None]
    if missing:
        todo = [items[at] for at in missing]
        for done, (place, raw) in enumerate(
            each(drive_all, todo, workers, items[0].scenario.detector), 1
        ):
            found[missing[place]] = raw
            kept.put(todo[place].key(), raw)
            print(
                f"driven: {done}/{len(todo)}, {todo[place].scenario.name}",
                file=sys.stderr,
                flush=True,
            )
    drives = [[Brought(**one) for one in drive] for drive in found if drive is not None]
    figures = table(drives, policies)
    folder.mkdir(parents=True, exist_ok=True)
    whole = {**figures, "machine": machine_facts()}
    write_whole(folder / "driven.json", json.dumps(whole, indent=1) + "\n")
    write_whole(folder / "driven.md", report(figures))
    return figures


def drive_of(scenario: Scenario, window: int) -> Drive:
    """A scenario's window, as an ego drives it."""
    return Drive(
        world=scenario.world,
        seed=scenario.seed,
        robots=scenario.robots,
        ego=scenario.ego,
        first=scenario.decision_frame(window),
        frames=scenario.window_frames + SETTLED_FRAMES,
        kind=scenario.kind,
        rings=scenario.rings,
        room=scenario.room,
        pose_noise_m=scenario.pose_noise_m,
        pose_memory=True,
    )


def drive_all(item: _Item) -> list[dict[str, float]]:
    """What each policy brings in a scenario's window, as plain values."""
    scenario, window = item.scenario, item.window
    drive = drive_of(scenario, window)
    driven, from_s = Driven(drive), window * WINDOW_S
    mean_bps = scenario.link.mean_bps(from_s, from_s + drive.frames / driven.world.rate_hz)
    return [
        asdict(_brought(driven, policy, scenario, from_s, mean_bps)) for policy in item.policies
    ]


def _brought(
    driven: Driven, policy: Policy, scenario: Scenario, from_s: float, mean_bps: float
) -> Brought:
    way = Way(
        policy.name,
        policy.forms,
        memory=policy.memory,
        in_turn=True,
        places_hz=policy.places_hz,
        objects_only=policy.objects_only,
        link=scenario.link,
        link_from_s=from_s,
        decided=policy.decided,
    )
    return brought(measure(driven, way), driven.world.rate_hz, mean_bps)


def brought(one: Measured, rate_hz: float, mean_bps: float) -> Brought:
    """The figures of a drive, on a link that carries so much on average."""
    precision, fused, due = one.tally.precision(), max(1, one.tally.frames), max(1, one.due)
    return Brought(
        ap_50=precision.ap_50,
        ap_70=precision.ap_70,
        ap_70_with_known=precision.ap_70_with_known,
        ground_truth=precision.ground_truth,
        false_per_frame=precision.false_per_frame,
        bytes_per_frame=one.bytes / due,
        participants=1.0 + one.taking_part / fused,
        ego_ms_per_frame=one.ego_ms / fused,
        in_time_ratio=one.came / one.asked if one.asked else 1.0,
        fused_ratio=one.tally.frames / due,
        infeasible=float(8.0 * one.wanted_bytes / fused * rate_hz > mean_bps),
        mota=one.following.figures(rate_hz)["mota"],
    )


def table(
    drives: Sequence[Sequence[Brought]], policies: Sequence[Policy] = POLICIES
) -> dict[str, Any]:
    """Means over the drives that hold a true box, by policy, and the default policy beside its
    controls in pairs of drives, with 95 % bootstrap intervals. `drives`: of each, what the
    policies brought. Raises EvaluationError where none holds a true box."""
    drives = [drive for drive in drives if drive[0].ground_truth]
    if not drives:
        raise EvaluationError("no drive of these scenarios holds a true box")
    columns = dict(
        zip((policy.name for policy in policies), zip(*drives, strict=True), strict=True)
    )
    rows = [_row(policy, columns[policy.name]) for policy in policies]
    bytes_of = {row["policy"]: row["bytes_per_frame"] for row in rows}
    ego_ms_of = {row["policy"]: row["ego_ms_per_frame"] for row in rows}
    participants_of = {row["policy"]: row["participants_mean"] for row in rows}
    beside = []
    for control in (*CONTROLS, *(one.name for one in ADVISED if one.name in columns)):
        pairs = zip(columns[DEFAULT], columns[control], strict=True)
        gap = bootstrap_mean([ours.ap_70 - theirs.ap_70 for ours, theirs in pairs])
        beside.append(
            {
                "policy": DEFAULT,
                "control": control,
                "difference": round(gap.mean, 4),
                "interval": [round(gap.low, 4), round(gap.high, 4)],
                "bytes_ratio": round(bytes_of[DEFAULT] / max(1.0, bytes_of[control]), 4),
                "ego_ms_ratio": round(ego_ms_of[DEFAULT] / ego_ms_of[control], 4),
                "participants_ratio": round(participants_of[DEFAULT] / participants_of[control], 4),
            }
        )
    return {"drives": len(drives), "rows": rows, "beside": beside}


def _row(policy: Policy, drives: Sequence[Brought]) -> dict[str, Any]:
    def mean(name: str, digits: int = 4) -> float:
        return round(float(np.mean([getattr(one, name) for one in drives])), digits)

    return {
        "policy": policy.name,
        "memory": policy.memory,
        "delivered_ap_50": mean("ap_50"),
        "delivered_ap_70": mean("ap_70"),
        "delivered_ap_70_with_known": mean("ap_70_with_known"),
        "false_per_frame": mean("false_per_frame", 3),
        "mota": mean("mota"),
        "bytes_per_frame": mean("bytes_per_frame", 1),
        "participants_mean": mean("participants", 3),
        "ego_ms_per_frame": mean("ego_ms_per_frame", 2),
        "in_time_ratio": mean("in_time_ratio"),
        "fused_ratio": mean("fused_ratio"),
        "infeasible_ratio": mean("infeasible"),
    }


def report(figures: Mapping[str, Any]) -> str:
    """The figures as Markdown."""
    rows = markdown(
        (
            "policy", "AP@0.7", "with known", "AP@0.5", "false boxes", "MOTA", "in time",
            "kB/frame", "robots", "ego ms", "fused", "infeasible",
        ),
        [
            (
                one["policy"], f"{one['delivered_ap_70']:.3f}",
                f"{one['delivered_ap_70_with_known']:.3f}", f"{one['delivered_ap_50']:.3f}",
                f"{one['false_per_frame']:.2f}", f"{one['mota']:.2f}",
                f"{one['in_time_ratio']:.0%}", f"{one['bytes_per_frame'] / 1e3:.1f}",
                f"{one['participants_mean']:.1f}", f"{one['ego_ms_per_frame']:.1f}",
                f"{one['fused_ratio']:.0%}", f"{one['infeasible_ratio']:.0%}",
            )
            for one in figures["rows"]
        ],
    )  # fmt: skip
    beside = markdown(
        (f"{DEFAULT} beside", "AP@0.7", "95 % interval", "bytes", "robots", "ego's compute"),
        [
            (
                one["control"], f"{one['difference']:+.3f}",
                "[{:+.3f}, {:+.3f}]".format(*one["interval"]), f"{one['bytes_ratio']:.2f}",
                f"{one['participants_ratio']:.2f}", f"{one['ego_ms_ratio']:.2f}",
            )
            for one in figures["beside"]
        ],
    )  # fmt: skip
    parts = [
        "# Policies as an ego runs them",
        f"{figures['drives']} drives of 5 s, decided every second. AP@0.7 of what came in time and "
        "of what is remembered; with known: also of the robots of which beacons tell. Fused: "
        "of the drive's frames. Infeasible: more is asked for than the link carries.",
        rows,
        "In pairs of drives; ratios of means.",
        beside,
    ]
    return "\n\n".join(parts) + "\n"
