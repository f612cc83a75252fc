"""A site of many robots that replay what a few robots of the factory have told.

Each robot stands where its density puts it, and drives as one of the recorded did: its beacons and
scenes are those, moved to its place. The nearest 20 are within the ego's range, however many there
are: robots lie on a spiral with equal ground for each (a sunflower's).

`python -m research.benchmarks.scale_site --router R --robots 1000 --of 0/2`: replays a share of
them in this process until standard input ends.
"""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import msgspec
import numpy as np

from research.benchmarks.processes import WAIT_S
from sensing.telling import Teller
from swarm import keyspace
from swarm.areas import cell_of, name_of
from swarm.arrays import pack, unpack_finite
from swarm.messages import Beacon, SceneDescription
from swarm.session import Session
from worlds.factory.world import FactoryWorld

SWARM, EGO = "bench-scale", "R1"
IN_RANGE, RANGE_M = 20, 45.0
BEACON_HZ, BEACONS_A_SCENE = 10, 5
RECORDED, FRAMES = 6, 20
"""Robots and frames of the recording: two seconds, played to and fro."""
SIZES = {"early": 12_000, "intermediate-codebook": 4_000, "late": 700}
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))

Put = Callable[[str, Beacon | SceneDescription], None]


class Track(NamedTuple):
    """What one robot told: a beacon of each frame, a scene of every fifth."""

    beacons: tuple[Beacon, ...]
    scenes: tuple[SceneDescription, ...]


def place_of(number: int) -> tuple[float, float]:
    """Where the robot of that number stands, metres; 0 is the ego."""
    away = RANGE_M * math.sqrt(number / (IN_RANGE + 0.5))
    return away * math.cos(number * GOLDEN), away * math.sin(number * GOLDEN)


@lru_cache(maxsize=1)
def recording() -> tuple[Track, ...]:
    """What robots of the factory tell of themselves."""
    world = FactoryWorld(robots=RECORDED, seed=1)
    tracks = []
    for robot in world.robots:
        teller = Teller(world, robot, 1, time.time_ns)
        beacons, scenes = [], []
        for frame in range(FRAMES):
            scan = world.scan(robot, frame)
            beacons.append(teller.beacon(frame, 0, scan.pose, scan.velocity, SIZES))
            if frame % BEACONS_A_SCENE == 0:
                scenes.append(teller.description(frame, 0, scan.pose, scan.points))
        tracks.append(Track(tuple(beacons), tuple(scenes)))
    return tuple(tracks)


class Replayed:
    """One robot of the site."""

    def __init__(self, number: int, areas: bool) -> None:
        self.robot = f"R{number + 1}"
        self._areas = areas
        track = recording()[number % RECORDED]
        x, y = place_of(number)
        east, north = x - track.beacons[0].pose[0], y - track.beacons[0].pose[1]
        self._beacons = [_moved(beacon, self.robot, east, north) for beacon in track.beacons]
        self._scenes = [_seen(scene, self.robot, east, north) for scene in track.scenes]
        self._turn = number % BEACONS_A_SCENE
        self._step = 0

    def tell(self, put: Put) -> None:
        """The next beacon, and the next scene where it is due."""
        step = self._step
        self._step += 1
        to_and_fro = step % (2 * FRAMES - 2)
        frame = min(to_and_fro, 2 * FRAMES - 2 - to_and_fro)
        self._put(put, keyspace.beacon, self._beacons[frame], step)
        if (step + self._turn) % BEACONS_A_SCENE == 0:
            self._put(put, keyspace.scene, self._scenes[frame // BEACONS_A_SCENE], step)

    def own(self) -> tuple[Beacon, SceneDescription]:
        """What it senses first, as now."""
        now_ns = time.time_ns()
        beacon, scene = self._beacons[0], self._scenes[0]
        return (
            msgspec.structs.replace(beacon, sent_ns=now_ns, capture_ns=now_ns),
            msgspec.structs.replace(scene, sent_ns=now_ns, capture_ns=now_ns),
        )

    def _put(
        self,
        put: Put,
        key: Callable[[str, str], str],
        told: Beacon | SceneDescription,
        seq: int,
    ) -> None:
        now_ns = time.time_ns()
        told = msgspec.structs.replace(told, seq=seq, frame=seq, sent_ns=now_ns, capture_ns=now_ns)
        where = key(SWARM, self.robot)
        if self._areas:
            where = keyspace.within(where, name_of(cell_of(*told.pose[:2])))
        put(where, told)


def _moved(beacon: Beacon, robot: str, east: float, north: float) -> Beacon:
    x, y, *rest = beacon.pose
    pose = (x + east, y + north, *rest)
    return msgspec.structs.replace(beacon, robot=robot, pose=pose)


def _seen(scene: SceneDescription, robot: str, east: float, north: float) -> SceneDescription:
    x, y, *rest = scene.pose
    objects = unpack_finite(scene.objects, "objects", 9).copy()
    objects[:, :2] += np.array([east, north], dtype=np.float32)
    pose = (x + east, y + north, *rest)
    return msgspec.structs.replace(scene, robot=robot, pose=pose, objects=pack(objects))


def replay(
    session: Session, robots: Sequence[Replayed], beacon_hz: float, ended: threading.Event
) -> None:
    """Tells at a rate until ended; what the machine has no time for is left out."""
    for robot in robots:
        session.declare_alive(robot.robot)
    due = time.monotonic()
    while not ended.wait(max(0.0, due - time.monotonic())):
        for robot in robots:
            robot.tell(session.put)
        due = max(due + 1.0 / beacon_hz, time.monotonic())


def _until_input_ends(ended: threading.Event) -> None:
    sys.stdin.read()
    ended.set()


def main() -> None:
    """Replays until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--router", required=True)
    parser.add_argument("--robots", type=int, required=True)
    parser.add_argument("--of", default="0/1")
    parser.add_argument("--areas", action="store_true")
    parser.add_argument("--beacon-hz", type=float, default=BEACON_HZ)
    args = parser.parse_args()
    part, parts = map(int, args.of.split("/"))
    robots = [Replayed(number, args.areas) for number in range(1, args.robots)][part::parts]
    ended = threading.Event()
    with Session(args.router, SWARM, timeout_s=WAIT_S) as session:
        threading.Thread(target=_until_input_ends, args=(ended,), daemon=True).start()
        print("up", flush=True)
        replay(session, robots, args.beacon_hz, ended)


if __name__ == "__main__":
    main()
