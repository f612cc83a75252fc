"""Recordings of a swarm that never ran: its messages come from function calls."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deploy.spec import make_spec
from options.recordings.format import Points
from options.recordings.listen import Received
from options.recordings.outlet import Outlet
from options.recordings.recorder import Recorder
from options.recordings.scans import Scans
from options.recordings.sink import Sink
from perception.fusion.aligner import Remembering
from swarm.arrays import pack
from swarm.messages import Decision, Detections
from swarm.process import capture_ns
from worlds.cooperative.fusing import fuse_frame
from worlds.factory.world import FactoryWorld

EPOCH_NS = 1_780_000_000_123_456_789


def detections(world: FactoryWorld, number: int, poses: Remembering | None = None) -> Detections:
    """What an ego says of a frame of R1 and R2; R3 was asked, too. `poses`: what it knows of
    theirs."""
    fused = fuse_frame(world, number, "R1", ["R2"], "late", poses=poses)
    boxes = fused.boxes
    table = np.column_stack([boxes.centers, boxes.sizes, boxes.headings]).astype(np.float32)
    return Detections(
        ego="R1",
        cycle=number // 10,
        frame=number,
        capture_ns=capture_ns(EPOCH_NS, world.rate_hz, number),
        algorithm="late",
        participants=("R1", "R2"),
        missing={"R3": "deadline: no answer within 0.25 s"},
        boxes=pack(table),
        scores=pack(boxes.scores.astype(np.float32).reshape(-1, 1)),
        labels=boxes.labels,
        bytes=fused.bytes,
        latency_ms=20.0,
    )


DECISION = Decision(
    ego="R1",
    cycle=4,
    decided_ns=EPOCH_NS,
    participants=("R1", "R2"),
    algorithm="late",
    reason="R2 sees what R1 does not",
    source="policy",
    policy="coverage",
    valid=True,
    capacity_bps=5e6,
)


def write_recording(
    path: Path,
    frames: Sequence[int | Detections],
    robots: int = 3,
    points: Points = "all",
    *,
    whole: bool = False,
) -> Path:
    """A recording of these frames of a factory with LiDARs of 16 rings, by number or as an ego
    told them. The last comes twice."""
    ids = tuple(f"R{number}" for number in range(1, robots + 1))
    spec = make_spec(robots=ids, rings=16, epoch_ns=EPOCH_NS, run_dir=str(path.parent))
    scans = Scans(spec, points, None, whole=whole) if points != "none" else None
    world = FactoryWorld(robots=robots, rings=16)
    outlet = Outlet(Sink(path))
    recorder = Recorder(spec, outlet, scans, points, EPOCH_NS)
    recorder.take(Received(DECISION, EPOCH_NS))
    for one in (*frames, frames[-1]):
        fused = detections(world, one) if isinstance(one, int) else one
        recorder.take(Received(fused, EPOCH_NS))
        recorder.flush()
    assert recorder.fused == len(frames)
    outlet.close()
    return path
