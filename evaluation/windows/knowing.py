"""What a live ego would know when it decides: the newest beacons and scene descriptions."""

from __future__ import annotations

import msgspec
import numpy as np

from ego_agent.model import RobotView, Snapshot
from evaluation.cooperative import disturbed
from perception.detector import configuration
from perception.fusion.base import EncodeOptions, Fusion
from perception.scene import describe, to_array, visible_range
from swarm.arrays import pack
from swarm.messages import Beacon, SceneDescription
from worlds.base import World

SECTORS = 72
EPOCH_NS = 1_700_000_000_000_000_000
BEACON_AGE_S, SCENE_AGE_S = 0.05, 0.2
"""Half the periods at which robots send them."""

Heard = dict[str, tuple[Beacon, SceneDescription]]


def heard(
    world: World,
    frame: int,
    ego: str,
    fusions: dict[str, Fusion],
    pose_noise_m: float = 0.0,
    reach_m: float = np.inf,
) -> Heard:
    """The beacon and the description of every robot as of one frame; those farther from the ego
    than `reach_m` only tell where they are. `fusions`: whose sizes beacons announce."""
    here = world.pose(ego, frame)
    found: Heard = {}
    for robot in world.robots:
        near = robot == ego or world.pose(robot, frame).distance_to(here) <= reach_m
        noise = pose_noise_m if robot != ego else 0.0
        found[robot] = _heard(world, frame, robot, fusions if near else {}, noise)
    return found


def packed(messages: Heard) -> bytes:
    """The messages as bytes, for `unpacked`."""
    return msgspec.msgpack.encode(messages)


def unpacked(raw: bytes) -> Heard:
    """The messages that `packed` made these bytes of."""
    return msgspec.msgpack.decode(raw, type=Heard)


def snapshot(ego: str, heard: Heard, capacity_bps: float) -> Snapshot:
    """The snapshot of an ego that has just heard that."""
    return Snapshot(
        ego=ego,
        cycle=0,
        now_ns=EPOCH_NS,
        robots={
            robot: RobotView(
                robot=robot,
                alive=True,
                beacon=beacon,
                beacon_age_s=BEACON_AGE_S,
                scene=scene,
                scene_age_s=SCENE_AGE_S,
                round_trip_s=None,
                clock_offset_s=0.0,
                duplicate=False,
            )
            for robot, (beacon, scene) in heard.items()
        },
        capacity_bps=capacity_bps,
        capacity_source="prior",
    )


def _heard(
    world: World, frame: int, robot: str, fusions: dict[str, Fusion], pose_noise_m: float
) -> tuple[Beacon, SceneDescription]:
    scan = world.scan(robot, frame)
    own_body_m = configuration(world.detector).own_body_m
    described = describe(scan.points, own_body_m=own_body_m)
    believed = disturbed(scan.pose, robot, frame, pose_noise_m)
    visible = visible_range(scan.points, SECTORS, believed.heading, own_body_m)
    pose = believed.as_tuple()
    options = EncodeOptions(pose=believed)
    beacon = Beacon(
        robot=robot,
        instance=1,
        seq=1,
        sent_ns=EPOCH_NS,
        capture_ns=EPOCH_NS,
        frame=frame,
        pose=pose,
        velocity=scan.velocity,
        range_m=world.range_m,
        sizes={name: len(fusion.encode(scan.points, options)) for name, fusion in fusions.items()},
    )
    scene = SceneDescription(
        robot=robot,
        instance=1,
        seq=1,
        sent_ns=EPOCH_NS,
        capture_ns=EPOCH_NS,
        frame=frame,
        pose=pose,
        objects=pack(to_array(described, believed.matrix())),
        visible_m=pack(np.asarray(visible, dtype=np.float32).reshape(-1, 1)),
        ground_points=described.ground_points,
        elapsed_ms=0.0,
    )
    return beacon, scene
