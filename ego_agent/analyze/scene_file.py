"""A scene as a JSON document, for `coadapt decide`; docs/decision.md describes the format."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, TypeVar

import msgspec
import numpy as np

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import RobotView, Snapshot
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.quality import packaged_quality
from perception.fusion.algorithms import all_fusions
from swarm.arrays import pack
from swarm.errors import DecisionError
from swarm.messages import (
    ALGORITHMS,
    Algorithm,
    Assignment,
    Beacon,
    Count,
    Decision,
    RobotId,
    SceneDescription,
)

S = TypeVar("S", bound=msgspec.Struct)
Number = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
Age = Annotated[float, msgspec.Meta(ge=0, le=1e9)]
Place = tuple[Number, Number, Number]


class ObjectEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object of one robot's description, in the world frame; `coadapt scene --json` gives the
    same fields in the sensor's frame."""

    centroid: Place
    points: Count
    distance: Age = 0.0
    size: Place = (0.0, 0.0, 0.0)
    density: Age = 0.0


class RobotEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the ego knows of one robot."""

    pose: tuple[Number, Number, Number, Number, Number, Number]
    """Sensor in the world: x, y, z in metres, roll, pitch, yaw in radians."""
    sizes: dict[Algorithm, Count] = {}
    """Bytes of one observation by algorithm; the ego needs none."""
    objects: tuple[ObjectEntry, ...] = ()
    visible_m: tuple[Annotated[float, msgspec.Meta(ge=0, le=1e9)], ...] = ()
    """How far the ground is seen in equal sectors of world azimuth, from east counter-clockwise."""
    alive: bool = True
    beacon_age_s: Age = 0.0
    scene_age_s: Age = 0.0
    duplicate: bool = False
    capacity_bps: Annotated[float, msgspec.Meta(ge=1, le=1e15)] | None = None
    """What its own link delivers, bit/s, where that is less than the cell does."""
    answers_s: dict[Algorithm, tuple[Age | None, ...]] = {}
    """How many seconds its last answers took by algorithm, oldest first; null: it never came."""


class PreviousEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The decision in force."""

    participants: tuple[RobotId, ...]
    algorithm: Algorithm
    assignments: tuple[Assignment, ...] = ()
    """What each sends, and how often, where that is not the same of all."""


class SceneFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The whole document."""

    ego: RobotId
    capacity_bps: Annotated[float, msgspec.Meta(ge=1, le=1e15)]
    robots: dict[RobotId, msgspec.Raw]
    """By id, the ego among them; each a `RobotEntry`, read apart so that an error can name it."""
    objective: Objective = Objective()
    """Only the fields that shall differ from their defaults."""
    algorithms: tuple[Algorithm, ...] | None = None
    """Available algorithms; by default the three paradigms."""
    previous: PreviousEntry | None = None
    detector: str = ""
    """Whose quality and work count; where none is named, Q is a share and work costs nothing."""


@dataclass(frozen=True, slots=True)
class Case:
    """A document, ready to be decided on."""

    snapshot: Snapshot
    knowledge: Knowledge
    previous: Decision | None


def read_scene(document: bytes, now_ns: int) -> Case:
    """The case that a JSON document describes, as if it had been observed at `now_ns`.

    Raises DecisionError that names the place, the value's fault and what is allowed.
    """
    scene = _decode(document, SceneFile, "")
    if scene.ego not in scene.robots:
        raise DecisionError(
            f"the scene is not valid: ego {scene.ego!r} is not one of the robots: "
            f"{', '.join(scene.robots) or 'there are none'}"
        )
    available = ALGORITHMS if scene.algorithms is None else scene.algorithms
    _check_algorithms("algorithms", available)
    if scene.detector and scene.detector not in packaged_quality():
        raise DecisionError(
            f"the scene is not valid: detector {scene.detector!r} has no quality model; allowed: "
            f"{', '.join(packaged_quality())}"
        )
    knowledge = Knowledge.of_detector(scene.detector, scene.objective, available)
    entries = {
        robot: _decode(entry, RobotEntry, f"robot {robot}: ")
        for robot, entry in scene.robots.items()
    }
    snapshot = Snapshot(
        ego=scene.ego,
        cycle=0,
        now_ns=now_ns,
        robots={robot: _view(robot, entry, now_ns) for robot, entry in entries.items()},
        capacity_bps=scene.capacity_bps,
        capacity_source="prior",
    )
    for robot, entry in entries.items():
        _teach(knowledge, robot, entry, scene.capacity_bps)
    return Case(snapshot, knowledge, _previous(scene, now_ns))


def _decode(document: bytes | msgspec.Raw, kind: type[S], where: str) -> S:
    try:
        return msgspec.json.decode(document, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DecisionError(f"the scene is not valid: {where}{error}") from error


def _check_algorithms(where: str, names: Iterable[str]) -> None:
    known = all_fusions()
    for name in names:
        if name not in known:
            raise DecisionError(
                f"the scene is not valid: {where}: algorithm {name!r} is unknown; "
                f"allowed: {', '.join(known)}"
            )


def _view(robot: str, entry: RobotEntry, now_ns: int) -> RobotView:
    _check_algorithms(f"robot {robot}: sizes", entry.sizes)
    objects = np.array(
        [[*o.centroid, o.distance, *o.size, o.points, o.density] for o in entry.objects],
        dtype=np.float32,
    ).reshape(-1, 9)
    visible = np.array(entry.visible_m, dtype=np.float32).reshape(-1, 1)
    beacon = Beacon(
        robot=robot,
        instance=0,
        seq=0,
        sent_ns=now_ns,
        capture_ns=now_ns,
        frame=0,
        pose=entry.pose,
        velocity=(0.0, 0.0, 0.0),
        range_m=max(1.0, *entry.visible_m) if entry.visible_m else 1.0,
        sizes={str(name): size for name, size in entry.sizes.items()},
    )
    description = SceneDescription(
        robot=robot,
        instance=0,
        seq=0,
        sent_ns=now_ns,
        capture_ns=now_ns,
        frame=0,
        pose=entry.pose,
        objects=pack(objects),
        visible_m=pack(visible),
        ground_points=0,
        elapsed_ms=0.0,
    )
    return RobotView(
        robot=robot,
        alive=entry.alive,
        beacon=beacon,
        beacon_age_s=entry.beacon_age_s,
        scene=description,
        scene_age_s=entry.scene_age_s,
        round_trip_s=None,
        clock_offset_s=0.0,
        duplicate=entry.duplicate,
        capacity_bps=math.inf if entry.capacity_bps is None else entry.capacity_bps,
    )


def _teach(knowledge: Knowledge, robot: str, entry: RobotEntry, capacity_bps: float) -> None:
    _check_algorithms(f"robot {robot}: answers_s", entry.answers_s)
    for algorithm, answers_s in entry.answers_s.items():
        for answer_s in answers_s:
            took_s = math.inf if answer_s is None else answer_s
            knowledge.experience.record(robot, algorithm, took_s, capacity_bps=capacity_bps)


def _previous(scene: SceneFile, now_ns: int) -> Decision | None:
    if scene.previous is None:
        return None
    return Decision(
        ego=scene.ego,
        cycle=0,
        decided_ns=now_ns,
        participants=scene.previous.participants,
        algorithm=scene.previous.algorithm,
        assignments=scene.previous.assignments,
        reason="",
        source="policy",
        policy="",
        valid=True,
    )
