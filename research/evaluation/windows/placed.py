"""Whose contributions an ego could lay in their places before a window began."""

from __future__ import annotations

from collections.abc import Mapping

from ego_agent.knowledge.placing import REMEMBERED, Placing
from perception.fusion.base import Fusion
from worlds.base import World
from worlds.cooperative.fusing import Disturbance, fuse_frame

FRAMES = round(REMEMBERED)
"""Before the window's first one: as many as an ego remembers."""
STEP = 2
"""Every so many-th of them is fused, and stands for the others."""

Placed = Mapping[str, tuple[bool, ...]]
"""By robot: whether it was fused or left out, frame after frame."""


def placed(
    world: World, before: int, ego: str, reach_m: float, fusion: Fusion, pose_noise_m: float
) -> Placed:
    """Who could be placed in the last frames before that one, had all robots within `reach_m` of
    the ego been asked in each of them; empty in a world's first frame. Raises as `fuse_frame`."""
    here = world.pose(ego, before)
    near = [
        robot
        for robot in world.robots
        if robot != ego and world.pose(robot, before).distance_to(here) <= reach_m
    ]
    noise = Disturbance(pose_noise_m=pose_noise_m)
    rejected = [
        fuse_frame(world, frame, ego, near, fusion, noise).rejected.keys()
        for frame in range(max(0, before - FRAMES), before, STEP)
    ]
    return {robot: tuple(robot not in one for one in rejected) for robot in near}


def learnt(found: Placed) -> Placing:
    """What an ego has learnt from that when the window begins."""
    placing = Placing(lambda: 0.0)
    for robot, frames in found.items():
        for well in frames:
            for _ in range(STEP):
                placing.record(robot, placed=well)
    return placing
