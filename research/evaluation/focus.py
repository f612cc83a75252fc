"""What a soft wish shifts: places that are to count more, on generated floors with narrow links.

    python -m research.evaluation.focus --floors 12 --out build/eval/focus.json

For each frame, `coverage` decides without a wish and with one for each of the floor's places. What
is then seen and found in that place stands beside the same without a wish, and beside a wish for
another place: a control that weighs as much, but elsewhere.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.intents.bind import bound_scene, contains, inside
from ego_agent.plan.intents.combine import Standing, standing
from ego_agent.plan.intents.obey import plan_obeying
from ego_agent.plan.policies.coverage import Coverage
from perception.fusion.base import Fusion
from perception.fusion.registry import make_fusion
from perception.metrics import average_precision
from perception.types import Boxes
from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.windows.announcements import heard, snapshot
from swarm.messages import Decision, Focus, Intent, IntentInForce, Place
from worlds.cooperative.fusing import SINGLE, fuse_frame
from worlds.cooperative.judging import judge
from worlds.factory.layout import build_floor
from worlds.factory.places import named_places
from worlds.factory.world import FactoryWorld

FIRST_SEED = 7_000
"""No detector and no quality model has seen these floors."""
ROBOTS = 8
ALGORITHMS = ("early", "intermediate", "late")
FRAMES = (50, 250, 450)
WANTED = ("docks", "aisle 1", "aisle 3", "cross aisle 3")
"""Objects move in all of them, and none lies all around the ego."""
IOU = 0.7
Scored = list[tuple[Boxes, Boxes]]


@dataclass(frozen=True, slots=True)
class Choice:
    """What is fused."""

    participants: tuple[str, ...]
    algorithm: str


Floor = dict[str, dict[str, dict[str, float]]]
"""Figures by place and by wish."""


def measure_floor(seed: int, capacity_bps: float) -> Floor:
    """By place and by wish (`none`, `place`, `another`): the share of what all see there (`seen`),
    AP@0.7 of the objects there (`ap_there`) and of all others (`ap_elsewhere`), kB a frame."""
    world = FactoryWorld(robots=ROBOTS, seed=seed)
    floor = build_floor(ROBOTS, np.random.default_rng(seed))
    places = [Place(name, polygon) for name, polygon in named_places(floor)]
    fusions = {name: make_fusion(name, world.detector) for name in ALGORITHMS}
    knowledge = Knowledge.of_detector(world.detector, Objective(), ALGORITHMS, learns=False)
    scored: dict[tuple[str, str, str], Scored] = defaultdict(list)
    seen: dict[tuple[str, str], list[float]] = defaultdict(list)
    sent: dict[tuple[str, str], list[float]] = defaultdict(list)
    ego = world.robots[0]
    for frame in FRAMES:
        messages = heard(world, frame, ego, dict(fusions))
        scene = analyze(snapshot(ego, messages, capacity_bps), knowledge)
        found: dict[Choice, tuple[Boxes, Boxes]] = {}
        decisions = {name: _decided(scene, knowledge, name, places) for name in ("", *WANTED)}
        for at, place in enumerate(WANTED):
            another = WANTED[(at + 1) % len(WANTED)]
            here = [one for one in places if one.name == place]
            for wish, name in (("none", ""), ("place", place), ("another", another)):
                decision = decisions[name]
                boxes, truth = _fused(world, frame, decision, fusions, found)
                for there, part in ((True, "there"), (False, "elsewhere")):
                    pair = (_within(boxes, here, there), _within(truth, here, there))
                    scored[place, wish, part].append(pair)
                share = _share(scene, decision, here)
                if share is not None:
                    seen[place, wish].append(share)
                sent[place, wish].append(decision.cost_bytes / 1e3)
    return {
        place: {
            wish: {
                "seen": _mean(seen[place, wish]),
                "ap_there": _precision(scored[place, wish, "there"]),
                "ap_elsewhere": _precision(scored[place, wish, "elsewhere"]),
                "kb_a_frame": _mean(sent[place, wish]),
            }
            for wish in ("none", "place", "another")
        }
        for place in WANTED
    }


def _decided(
    scene: UnifiedScene, knowledge: Knowledge, name: str, places: Iterable[Place]
) -> Decision:
    wishes = Standing()
    if name:
        intent = Intent(focus=(Focus(name),))
        wishes = standing([IntentInForce(number=1, intent=intent, places=tuple(places))])
    bound = bound_scene(scene, wishes)
    empty = snapshot(scene.ego.robot, {}, scene.capacity_bps)
    return plan_obeying(empty, bound, Coverage(), knowledge, None, 0, 0, wishes)


def _fused(
    world: FactoryWorld,
    frame: int,
    decision: Decision,
    fusions: Mapping[str, Fusion],
    found: dict[Choice, tuple[Boxes, Boxes]],
) -> tuple[Boxes, Boxes]:
    """The found and the true boxes that count, once for each choice."""
    ego, *others = decision.participants
    choice = Choice(tuple(sorted(others)), decision.algorithm if others else SINGLE)
    if choice not in found:
        by: str | Fusion = fusions.get(choice.algorithm, SINGLE)
        fused = fuse_frame(world, frame, ego, choice.participants, by)
        found[choice] = judge(world, frame, ego, fused.boxes)
    return found[choice]


def _within(boxes: Boxes, places: Iterable[Place], there: bool) -> Boxes:
    held = contains(boxes.centers[:, 0], boxes.centers[:, 1], places)
    return boxes.take(np.flatnonzero(held == there))


def _share(scene: UnifiedScene, decision: Decision, places: Iterable[Place]) -> float | None:
    """Of the place's cells that anybody sees, the part that the chosen ones see; None where nobody
    sees any."""
    cells = inside(scene, places)
    robots = (scene.ego, *scene.candidates)
    every = np.any([robot.area for robot in robots], axis=0) & cells
    chosen = [robot.area for robot in robots if robot.robot in decision.participants]
    could = int(every.sum())
    return float((np.any(chosen, axis=0) & cells).sum()) / could if could else None


def _precision(frames: Scored) -> float:
    return (
        average_precision(frames, IOU) if any(len(truth.centers) for _, truth in frames) else np.nan
    )


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else np.nan


def summary(floors: Mapping[int, Floor]) -> list[dict[str, object]]:
    """For each figure: means without a wish, with one and with one for another place, and by how
    much the wish's differ, paired, with intervals over floors."""
    rows: list[dict[str, object]] = []
    for figure in ("seen", "ap_there", "ap_elsewhere", "kb_a_frame"):
        values: dict[str, list[float]] = defaultdict(list)
        groups: list[int] = []
        for seed, places in floors.items():
            for by_wish in places.values():
                row = {wish: figures[figure] for wish, figures in by_wish.items()}
                if not any(np.isnan(value) for value in row.values()):
                    groups.append(seed)
                    for wish, value in row.items():
                        values[wish].append(value)
        less = {
            control: np.subtract(values["place"], values[control]).tolist()
            for control in ("none", "another")
        }
        row_of: dict[str, object] = {"figure": figure, "count": len(groups)}
        for wish in ("none", "place", "another"):
            row_of[wish] = round(_mean(values[wish]), 4)
        for control, differences in less.items():
            row_of[f"over_{control}"] = str(bootstrap_mean(differences, groups))
        rows.append(row_of)
    return rows


def main() -> int:
    """Measures and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floors", type=int, default=12)
    parser.add_argument("--capacity-mbit", type=float, default=0.4)
    parser.add_argument("--out", type=Path, default=Path("build/eval/focus.json"))
    args = parser.parse_args()
    floors = {}
    for seed in range(FIRST_SEED, FIRST_SEED + args.floors):
        floors[seed] = measure_floor(seed, args.capacity_mbit * 1e6)
        print(f"floor {seed}", file=sys.stderr, flush=True)
    rows = summary(floors)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps({"capacity_mbit": args.capacity_mbit, "rows": rows}, indent=1))
    for row in rows:
        print("  ".join(f"{name} {value}" for name, value in row.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
