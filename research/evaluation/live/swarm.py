"""Starts a swarm for one scenario, policy and link, and listens to its ego for a while."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import TypeVar

import numpy as np

from deploy import ready, runtimes
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import need_state
from perception.types import Boxes
from research.evaluation.windows.scenarios import Scenario
from swarm.arrays import Array, unpack_finite
from swarm.errors import DeployError
from swarm.listening import Handlers, listen
from swarm.messages import Decision, Detections

START_S = 90.0
SETTLE_S = 5.0
"""After the first decision: the ego measures its link, robots fill their caches."""
CONNECT_S = 10.0
PORTS = range(24_000, 32_000, 16)
"""Below those that the kernel gives to outgoing connections."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Recorded:
    """What an ego published in a stretch of time."""

    seconds: float
    frames: tuple[Detections, ...]
    decisions: tuple[Decision, ...] = ()
    """In the same time."""


def boxes_of(frame: Detections) -> Boxes:
    """The boxes of a frame alone, in the world frame. Raises MessageError for a table that cannot
    be read."""
    return _boxes(frame.boxes, frame.scores, frame.labels)


def told_of(frame: Detections) -> Boxes:
    """What is there by all that was found until then, where the ego remembers; else the frame's
    boxes. Raises as `boxes_of` does."""
    tracks = frame.tracks
    if tracks is None:
        return boxes_of(frame)
    return _boxes(tracks.boxes, tracks.scores, tracks.labels)


def _boxes(boxes: Array, scores: Array, labels: tuple[str, ...]) -> Boxes:
    table = unpack_finite(boxes, "boxes", 7)
    return Boxes(
        centers=table[:, :3].astype(np.float64),
        sizes=table[:, 3:6].astype(np.float64),
        headings=table[:, 6].astype(np.float64),
        scores=unpack_finite(scores, "scores", 1)[:, 0].astype(np.float64),
        labels=labels,
    )


def evenly(members: Sequence[T], most: int) -> list[T]:
    """At most so many of them, evenly spread."""
    places = np.linspace(0, len(members) - 1, min(most, len(members))).astype(int)
    return [members[place] for place in places]


def record(
    scenario: Scenario, policy: str, link_bps: int, seconds: float, runtime: str, folder: Path
) -> Recorded:
    """The detections of a swarm of its own, which is gone afterwards.

    The swarm's clock is set so that it begins at the scenario's first frame. Raises DeployError
    when it cannot run here.
    """
    chosen, _ = runtimes.choose(runtime)
    spec = _spec(scenario, policy, link_bps, chosen.name, folder)
    chosen.up(spec)
    try:
        state = need_state(spec.swarm)
        ready.wait_ready(chosen, state, START_S)
        time.sleep(SETTLE_S)
        heard: Queue[Detections] = Queue()
        decided: list[Decision] = []
        handlers: Handlers = {Detections: heard.put, Decision: decided.append}
        with listen(state.router, spec.swarm, handlers, spec.ego, timeout_s=CONNECT_S):
            frames = _collect(heard, seconds)
            return Recorded(seconds, frames, tuple(decided))
    finally:
        chosen.down(spec.swarm)


def _spec(scenario: Scenario, policy: str, link_bps: int, runtime: str, folder: Path) -> SwarmSpec:
    robots = factory_robots(scenario.robots)
    port = _free_ports()
    return make_spec(
        swarm=f"eval-{port}",
        runtime=runtime,
        robots=robots,
        ego=robots[scenario.ego],
        seed=scenario.seed,
        scenario=scenario.kind,
        policy=policy,
        link_bps=link_bps,
        epoch_ns=time.time_ns() - round(scenario.first_frame * 1e8),
        prometheus=False,
        router_port=port,
        prometheus_port=port + 4,
        ego_metrics_port=port + 5,
        controller_metrics_port=port + 6,
        qod_port=port + 7,
        llm_port=port + 8,
        gateway_metrics_port=port + 9,
        var_dir=str((folder / "live" / f"{scenario.name}-{policy}-{link_bps}").absolute()),
    )


def _free_ports() -> int:
    """The first of a row of ports that nothing listens on. Raises DeployError without one."""
    for first in PORTS:
        with ExitStack() as stack:
            try:
                for port in range(first, first + PORTS.step):
                    taken = stack.enter_context(socket.socket())
                    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    taken.bind(("127.0.0.1", port))
            except OSError:
                continue
            return first
    raise DeployError(f"no {PORTS.step} free ports in a row from {PORTS.start} to {PORTS.stop}")


def _collect(heard: Queue[Detections], seconds: float) -> tuple[Detections, ...]:
    end = time.monotonic() + seconds
    frames = []
    while (left_s := end - time.monotonic()) > 0:
        try:
            frames.append(heard.get(timeout=left_s))
        except Empty:
            break
    return tuple(frames)
