"""Every algorithm runs live by name, and what it costs there is what it costs offline."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from perception.fusion.registry import fusion_names, make_fusion
from swarm.messages import Detections
from tests.support.ego_swarm import (
    factory,
    float32,
    in_float32,
    metrics_of,
    swarm_of,
    until,
)
from tests.support.free_ports import free_ports
from worlds.cooperative.fusing import Disturbance, fuse_frame
from worlds.factory.world import FactoryWorld

EGO, OTHER = "R1", "R2"
FRAMES = 4
MOST_LATE = 3
"""Scans that a robot may be behind the ego on a busy machine."""
USUAL = ("early", "intermediate-codebook")
"""Each takes real processes, so not all of them are for every `make test`."""


@pytest.fixture(autouse=True, scope="module")
def exact() -> Iterator[None]:
    """What two processes find is compared to the last digit."""
    with in_float32():
        yield


@pytest.mark.parametrize(
    "algorithm",
    [
        pytest.param(name, marks=() if name in USUAL else pytest.mark.slow)
        for name in fusion_names("factory")
    ],
)
def test_live_bytes_are_those_of_an_experiment_on_the_same_frames(
    algorithm: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    scans = tmp_path_factory.getbasetemp() / "scans"
    settings = {
        "ego": EGO,
        "policy": f"static-{algorithm}",
        "algorithms": algorithm,
        "comm_range_m": "500",
        "period_s": "0.5",
        "fusion_rate_hz": "2",
        "deadline_s": "0.45",
    }
    port = free_ports(1)
    with swarm_of(factory(scans) | float32(), tmp_path) as swarm:
        swarm.router()
        frames = swarm.detections(swarm.session(), EGO)
        swarm.robot(OTHER, metrics_port=str(port))
        swarm.ego(**settings)
        until(
            lambda: sum(map(shows, frames.all)) >= FRAMES,
            f"{FRAMES} frames of two robots",
        )
        heard = [frame for frame in frames.all if shows(frame)]
        sent = metrics_of(port)
    name = f'coadapt_robot_observation_bytes_total{{algorithm="{algorithm}",robot="{OTHER}"}}'
    assert sent[name] >= sum(frame.bytes[OTHER] for frame in heard)
    world = FactoryWorld(robots=2, rings=16, cache=scans)
    assert {frame.algorithm for frame in heard} == {algorithm}
    same = [frame.bytes[OTHER] == offline(world, frame) for frame in heard]
    # A robot that reads its scan later than the ego answers with the newest one that it has read.
    lags = [Disturbance(delay_s=behind / world.rate_hz) for behind in range(1, MOST_LATE + 1)]
    for frame in (frame for frame, agrees in zip(heard, same, strict=True) if not agrees):
        assert frame.bytes[OTHER] in [offline(world, frame, lag) for lag in lags]
    assert any(same)


def shows(frame: Detections) -> bool:
    """Whether the other one sent all that it sees."""
    return OTHER in frame.participants and OTHER not in frame.focused


def offline(world: FactoryWorld, frame: Detections, disturbance: Disturbance | None = None) -> int:
    """Payload bytes of the experiment; it also counts what the ego tells the robot."""
    number = frame.frame % world.frame_count
    fused = fuse_frame(world, number, EGO, world.robots, frame.algorithm, disturbance)
    own = world.scan(EGO, number)
    begun = make_fusion(frame.algorithm, world.detector).begin(own.points, own.pose.matrix())
    return fused.bytes[OTHER] - begun.ask().size()
