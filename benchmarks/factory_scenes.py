"""Unified scenes from simulated scans: what an ego would know if every message arrived at once."""

from __future__ import annotations

import numpy as np

from ego_agent.analyze import analyze
from ego_agent.knowledge import Knowledge
from ego_agent.model import RobotView, Snapshot, UnifiedScene
from perception.detector import configuration
from perception.fusion.base import EncodeOptions
from perception.fusion.registry import make_fusion
from perception.scene import describe, to_array, visible_range
from swarm.arrays import pack
from swarm.messages import ALGORITHMS, Beacon, SceneDescription
from worlds.base import World

SECTORS = 72
EPOCH_NS = 1_700_000_000_000_000_000


def factory_scene(
    world: World, frame: int, ego: str, knowledge: Knowledge, capacity_bps: float
) -> UnifiedScene:
    """The scene of one frame, with real encoded sizes, as the ego would analyze it."""
    snapshot = Snapshot(
        ego=ego,
        cycle=0,
        now_ns=EPOCH_NS,
        robots={robot: _view(world, robot, frame) for robot in world.robots},
        capacity_bps=capacity_bps,
        capacity_source="prior",
    )
    return analyze(snapshot, knowledge)


def _view(world: World, robot: str, frame: int) -> RobotView:
    scan = world.scan(robot, frame)
    own_body_m = configuration(world.detector).own_body_m
    found = describe(scan.points, own_body_m=own_body_m)
    visible = visible_range(scan.points, SECTORS, scan.pose.heading, own_body_m)
    sizes = {
        name: len(make_fusion(name, world.detector).encode(scan.points, EncodeOptions()))
        for name in ALGORITHMS
    }
    pose = scan.pose.as_tuple()
    return RobotView(
        robot=robot,
        alive=True,
        beacon=Beacon(
            robot=robot,
            instance=1,
            seq=1,
            sent_ns=EPOCH_NS,
            capture_ns=EPOCH_NS,
            frame=frame,
            pose=pose,
            velocity=scan.velocity,
            range_m=world.range_m,
            sizes=sizes,
        ),
        beacon_age_s=0.05,
        scene=SceneDescription(
            robot=robot,
            instance=1,
            seq=1,
            sent_ns=EPOCH_NS,
            capture_ns=EPOCH_NS,
            frame=frame,
            pose=pose,
            objects=pack(to_array(found, scan.pose.matrix())),
            visible_m=pack(np.asarray(visible, dtype=np.float32).reshape(-1, 1)),
            ground_points=found.ground_points,
            elapsed_ms=1.0,
        ),
        scene_age_s=0.2,
        round_trip_s=None,
        clock_offset_s=0.0,
        duplicate=False,
    )
