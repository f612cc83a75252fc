"""A swarm that is played, to measure the console: a router, the console's own process, robots that
only speak, an ego's voice, and viewers that read the stream as a page does.

`python -m research.benchmarks.console_stage speak|read`: those of these that run as processes of
their own.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deploy.ports import LOCALHOST
from research.benchmarks.controller import cpu_s
from research.benchmarks.processes import WAIT_S, await_port, free_ports, process
from swarm import keyspace
from swarm.arrays import Array, pack
from swarm.messages import Beacon, Decision, Detections, SceneDescription
from swarm.session import Session

SWARM, EGO = "bench-console", "R1"
BEACON_HZ, BEACONS_A_SCENE = 10, 5
"""As robots do: ten beacons and two scene descriptions a second."""
OBJECTS, BOXES, SECTORS = 40, 20, 72
GRID_M, COLUMNS = 5.0, 10
MARK = "decision "


@dataclass(frozen=True, slots=True)
class Played:
    """A console of its own, and the swarm it shows."""

    url: str
    port: int
    console: int
    """The console's process id."""
    robots: int
    ego: Session
    cycles: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def decide(self) -> tuple[str, float]:
        """Publishes the next decision, whose reason is `MARK` and its cycle; that, and when, in
        seconds since the epoch."""
        cycle = next(self.cycles)
        participants = tuple(f"R{i + 1}" for i in range(self.robots))
        decision = Decision(
            ego=EGO,
            cycle=cycle,
            decided_ns=time.time_ns(),
            participants=participants,
            algorithm="early" if cycle % 2 else "late",
            reason=f"{MARK}{cycle}",
            source="policy",
            policy="bench",
            valid=True,
            quality=0.9,
            cost_bytes=20_000,
            capacity_bps=5e6,
        )
        sent = time.time()
        self.ego.put(keyspace.decision(SWARM, EGO), decision)
        return str(cycle), sent

    def cpu_s(self) -> float:
        """Processor time that the console has taken."""
        return cpu_s(self.console)


@contextmanager
def played(robots: int) -> Iterator[Played]:
    """A router, `robots` that speak, and a console that has connected."""
    first = free_ports(4)
    router, port = f"tcp/{LOCALHOST}:{first}", first + 3
    settings = {
        "COADAPT_ROUTER": router,
        "COADAPT_SWARM": SWARM,
        "COADAPT_EGO": EGO,
        "COADAPT_CONSOLE_PORT": str(port),
        "COADAPT_METRICS_PORT": "0",
        "COADAPT_WORLD_ROBOTS": str(robots),
        "COADAPT_LOG_LEVEL": "error",
    }
    with ExitStack() as stack:
        stack.enter_context(process("swarm.router", "--port", str(first)))
        ego = stack.enter_context(Session(router, SWARM, timeout_s=WAIT_S))
        console = stack.enter_context(process("options.console", **settings))
        words = ("--router", router, "--robots", str(robots))
        stack.enter_context(process("research.benchmarks.console_stage", "speak", *words))
        await_port(port)
        yield Played(f"http://localhost:{port}", port, console.pid, robots, ego)


def rows(columns: int, count: int) -> Array:
    """Values that take as many digits as measured ones."""
    return pack(np.random.default_rng(1).uniform(1.0, 40.0, (count, columns)).astype(np.float32))


def _until_input_ends(ended: threading.Event) -> None:
    sys.stdin.read()
    ended.set()


def speak(router: str, robots: int) -> None:
    """Says what robots and their ego say between two decisions, until standard input ends."""
    visible, objects = rows(1, SECTORS), rows(9, OBJECTS)
    boxes, scores = rows(7, BOXES), rows(1, BOXES)
    ids = [f"R{i + 1}" for i in range(robots)]
    ended = threading.Event()
    threading.Thread(target=_until_input_ends, args=(ended,), daemon=True).start()
    with Session(router, SWARM, timeout_s=WAIT_S) as session:
        for robot in ids:
            session.declare_alive(robot)
        begun, seq = time.monotonic(), 0
        while not ended.wait(max(0.0, begun + seq / BEACON_HZ - time.monotonic())):
            seq += 1
            now = time.time_ns()
            common: dict[str, Any] = {"instance": 1, "seq": seq, "sent_ns": now}
            common |= {"capture_ns": now, "frame": seq}
            for i, robot in enumerate(ids):
                yaw = 0.05 * seq + i
                x = GRID_M * (i % COLUMNS) + math.cos(yaw)
                y = GRID_M * (i // COLUMNS) + math.sin(yaw)
                pose = (x, y, 0.6, 0.0, 0.0, yaw)
                beacon = Beacon(
                    robot=robot,
                    pose=pose,
                    velocity=(0.5, 0.0, 0.0),
                    range_m=30.0,
                    sizes={},
                    **common,
                )
                session.put(keyspace.beacon(SWARM, robot), beacon)
                if (seq + i) % BEACONS_A_SCENE == 0:
                    scene = SceneDescription(
                        robot=robot,
                        pose=pose,
                        objects=objects,
                        visible_m=visible,
                        ground_points=100,
                        elapsed_ms=4.0,
                        **common,
                    )
                    session.put(keyspace.scene(SWARM, robot), scene)
            detections = Detections(
                ego=EGO,
                cycle=1,
                frame=seq,
                capture_ns=now,
                algorithm="early",
                participants=tuple(ids),
                boxes=boxes,
                scores=scores,
                labels=("robot",) * BOXES,
                bytes=dict.fromkeys(ids[1:], 5000),
                latency_ms=31.0,
            )
            session.put(keyspace.detections(SWARM, EGO), detections)


@contextmanager
def viewers(port: int, count: int) -> Iterator[Any]:
    """Streams that are read; call what it gives, once, for each one's decisions: {cycle: when}."""
    words = ("--port", str(port), "--viewers", str(count))
    with process("research.benchmarks.console_stage", "read", *words) as reading:
        assert reading.stdout is not None
        reading.stdout.readline()  # All of them are connected.

        def seen() -> list[dict[str, float]]:
            found: list[dict[str, float]] = json.loads(reading.communicate(timeout=WAIT_S)[0])
            return found

        yield seen


async def read(port: int, count: int) -> None:
    """Reads streams until standard input ends; then writes when each decision came to each."""
    streams = [await asyncio.open_connection(LOCALHOST, port) for _ in range(count)]
    seen: list[dict[str, float]] = [{} for _ in streams]
    for _, writer in streams:
        writer.write(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    tasks = [
        asyncio.create_task(note(reader, one))
        for (reader, _), one in zip(streams, seen, strict=True)
    ]
    print("reading", flush=True)
    await asyncio.to_thread(sys.stdin.read)
    for task in tasks:
        task.cancel()
    print(json.dumps(seen))


async def note(reader: asyncio.StreamReader, seen: dict[str, float]) -> None:
    """Notes when decisions come; the rest is only read."""
    mark = MARK.encode()
    rest = b""
    while data := await reader.read(1 << 16):
        *lines, rest = (rest + data).split(b"\n\n")
        for line in lines:
            _, _, after = line.partition(mark)
            if after:
                seen.setdefault(after.partition(b'"')[0].decode(), time.time())


def main() -> int:
    """One of the processes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("speak", "read"))
    parser.add_argument("--router", default="")
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--viewers", type=int, default=1)
    args = parser.parse_args()
    if args.what == "speak":
        speak(args.router, args.robots)
    else:
        asyncio.run(read(args.port, args.viewers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
