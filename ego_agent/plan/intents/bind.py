"""What intents change before a policy decides: the scene and the objective."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.model import UnifiedScene, Weights
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.intents.combine import Standing, Wished, name_of
from perception.memory.memory import Remembered
from swarm.messages import Place
from swarm.messages.intent import Weight

WEIGHTS: dict[Weight, float] = {"low": 0.25, "high": 4.0}
"""What a cell or an object counts against one of which nothing is wished."""
DEARER = 4.0
"""By how much more costs what is to be saved."""
SAME_M = 1.5
"""An object of the scene is a known one this near to it, as when robots' objects are merged."""


@dataclass(frozen=True, slots=True)
class Known:
    """Objects of which the class is known: `labels` (N), and `centers` (N, 2) float32, x and y in
    the world frame."""

    labels: tuple[str, ...] = ()
    centers: NDArray[np.float32] | None = None


NOTHING_KNOWN = Known()


def known_objects(remembered: Remembered | None) -> Known:
    """What an ego's memory knows; nothing where it keeps none."""
    if remembered is None:
        return NOTHING_KNOWN
    boxes = remembered.boxes
    return Known(boxes.labels, boxes.centers[:, :2].astype(np.float32))


def bound_objective(objective: Objective, wishes: Standing) -> Objective:
    """The objective with the limits and prices that are wished."""
    changed: dict[str, object] = {}
    if wishes.q_min is not None:
        changed["q_min"] = wishes.q_min.value
    if wishes.link_share is not None:
        changed["headroom"] = min(objective.headroom, wishes.link_share.value)
    if wishes.save is not None:
        name = "lambda_link" if wishes.save.value == "bandwidth" else "lambda_compute"
        changed[name] = DEARER * getattr(objective, name)
    return msgspec.structs.replace(objective, **changed) if changed else objective


def bound_scene(
    scene: UnifiedScene, wishes: Standing, known: Known = NOTHING_KNOWN
) -> UnifiedScene:
    """The scene as every policy is to see it: without the candidates that are left out, and with
    the weights of places and of `known` objects' classes."""
    if not wishes.intents:
        return scene
    why = {c.robot: left_out(c.robot, wishes) for c in scene.candidates}
    return replace(
        scene,
        candidates=tuple(c for c in scene.candidates if not why[c.robot]),
        left_out=tuple(c for c in scene.candidates if why[c.robot]),
        excluded={**scene.excluded, **{robot: said for robot, said in why.items() if said}},
        weights=_weights(scene, wishes, known),
        preferred=wishes.prefer,
    )


def inside(scene: UnifiedScene, places: Iterable[Place]) -> NDArray[np.bool_]:
    """The scene's cells whose middle lies in one of the places, (G, G)."""
    side = len(scene.ego.area)
    middles = (np.arange(side) + 0.5 - side // 2) * scene.cell_m
    x, y = np.meshgrid(scene.ego.pose.x + middles, scene.ego.pose.y + middles)
    return contains(x, y, places)


def left_out(robot: str, wishes: Standing) -> str:
    """Why a robot may not take part; empty where it may."""
    if robot in wishes.exclude:
        return f"left out by {name_of(wishes.exclude[robot])}"
    if wishes.only is not None and robot not in wishes.only.value:
        return f"not among the only ones of {name_of(wishes.only.by)}"
    return ""


def _weights(scene: UnifiedScene, wishes: Standing, known: Known) -> Weights | None:
    if not wishes.focus and not wishes.classes:
        return None
    side = len(scene.ego.area)
    cells = np.ones((side, side), dtype=np.float32)
    objects = np.ones(len(scene.objects), dtype=np.float32)
    # The high ones last: they win where places overlap.
    for name, wished in sorted(wishes.focus.items(), key=lambda item: WEIGHTS[item[1].value]):
        places, weight = placed(name, wished), WEIGHTS[wished.value]
        cells[inside(scene, places)] = weight
        objects[contains(scene.objects[:, 0], scene.objects[:, 1], places)] = weight
    for at, label in _labelled(scene, known):
        if label in wishes.classes:
            objects[at] *= WEIGHTS[wishes.classes[label].value]
    return Weights(cells, objects)


def placed(name: str, wished: Wished[Weight]) -> list[Place]:
    """The polygons of a place, as the intent brought them that wishes something of it."""
    return [place for place in wished.by.places if place.name == name]


def _labelled(scene: UnifiedScene, known: Known) -> list[tuple[int, str]]:
    """Which objects of the scene are known, and as what."""
    if known.centers is None or not len(known.centers) or not len(scene.objects):
        return []
    apart = scene.objects[:, None, :2] - known.centers[None]
    squared = (apart.astype(np.float64) ** 2).sum(axis=2)
    nearest = squared.argmin(axis=1)
    near = np.flatnonzero(squared[np.arange(len(nearest)), nearest] <= SAME_M**2)
    return [(int(at), known.labels[nearest[at]]) for at in near]


def contains(
    x: NDArray[np.float64] | NDArray[np.float32],
    y: NDArray[np.float64] | NDArray[np.float32],
    places: Iterable[Place],
) -> NDArray[np.bool_]:
    """Which points lie in one of the polygons, by the number of edges that a ray to the east
    crosses."""
    found = np.zeros(np.shape(x), dtype=np.bool_)
    for place in places:
        odd = np.zeros(np.shape(x), dtype=np.bool_)
        for (x0, y0), (x1, y1) in _edges(place.polygon):
            if y0 != y1:
                crosses = (y0 > y) != (y1 > y)
                odd ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        found |= odd
    return found


def _edges(
    polygon: Sequence[tuple[float, float]],
) -> Iterable[tuple[tuple[float, float], tuple[float, float]]]:
    return zip(polygon, (*polygon[1:], polygon[0]), strict=True)
