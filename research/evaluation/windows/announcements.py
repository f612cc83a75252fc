"""What a live ego would know when it decides: the newest beacons and scene descriptions."""

from __future__ import annotations

import msgspec
import numpy as np

from ego_agent.knowledge.model import RobotView, Snapshot
from perception.fusion.base import EncodeOptions, Fusion
from sensing.telling import Teller
from swarm.messages import Beacon, SceneDescription
from worlds.base import World
from worlds.cooperative.pose_errors import disturbed

EPOCH_NS = 1_700_000_000_000_000_000
SCENE_AGE_FRAMES = 2
SCENE_AGE_S = 0.2
"""A scene description comes every fifth frame; the newest is this old on average, at 10 Hz."""
SIZES_AGE_FRAMES = 25
"""Robots measure their payloads every five seconds."""

Announced = dict[str, tuple[Beacon, SceneDescription]]


def heard(
    world: World,
    frame: int,
    ego: str,
    fusions: dict[str, Fusion],
    pose_noise_m: float = 0.0,
    reach_m: float = np.inf,
) -> Announced:
    """The newest beacon and description of every robot at the time of a frame.

    Poses are those of the frame, descriptions and sizes are as old as in a swarm, or of the first
    frame. Sizes are what a payload takes in the form that the ego asks for. Robots farther from the
    ego than `reach_m` announce none. `fusions`: whose sizes beacons announce.
    """
    here = world.pose(ego, frame)
    sized = max(0, frame - SIZES_AGE_FRAMES)
    own = world.scan(ego, sized)
    asks = {
        name: fusion.begin(own.points, own.pose.matrix()).ask() for name, fusion in fusions.items()
    }
    found: Announced = {}
    for robot in world.robots:
        noise = pose_noise_m if robot != ego else 0.0
        sizes = {}
        if robot != ego and world.pose(robot, frame).distance_to(here) <= reach_m:
            scan = world.scan(robot, sized)
            pose = disturbed(scan.pose, robot, sized, noise)
            for name, fusion in fusions.items():
                ask = asks[name]
                form = EncodeOptions(pose=pose, reference=ask.reference, demand=ask.demand)
                sizes[name] = len(fusion.encode(scan.points, form))
        found[robot] = (
            _beacon(world, frame, robot, sizes, noise),
            _description(world, max(0, frame - SCENE_AGE_FRAMES), robot, noise),
        )
    return found


def packed(messages: Announced) -> bytes:
    """The messages as bytes, for `unpacked`."""
    return msgspec.msgpack.encode(messages)


def unpacked(raw: bytes) -> Announced:
    """The messages that `packed` made these bytes of."""
    return msgspec.msgpack.decode(raw, type=Announced)


def snapshot(ego: str, heard: Announced, capacity_bps: float) -> Snapshot:
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
                beacon_age_s=0.0,
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


def _beacon(
    world: World, frame: int, robot: str, sizes: dict[str, int], pose_noise_m: float
) -> Beacon:
    believed = disturbed(world.pose(robot, frame), robot, frame, pose_noise_m)
    velocity = world.scan(robot, frame).velocity
    return _teller(world, robot).beacon(frame, EPOCH_NS, believed, velocity, sizes)


def _description(world: World, frame: int, robot: str, pose_noise_m: float) -> SceneDescription:
    scan = world.scan(robot, frame)
    believed = disturbed(scan.pose, robot, frame, pose_noise_m)
    told = _teller(world, robot).description(frame, EPOCH_NS, believed, scan.points)
    return msgspec.structs.replace(told, elapsed_ms=0.0)


def _teller(world: World, robot: str) -> Teller:
    return Teller(world, robot, instance=1, now_ns=lambda: EPOCH_NS)
