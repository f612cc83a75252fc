"""Observation round trip: from the ego's first query to the fused boxes, over real processes.

Six robots, each a `robot_agent` process of its own, and the ego's asking and fusing half in this
process, joined by a router over loopback TCP that nothing shapes. Early fusion, ground removed,
10 cm error bound, a round every third frame (3.3 Hz) while the robots sense at 10 Hz, send beacons
and describe their scenes as always. All seven share this machine's cores, which robots would not.

Encoding is included: no payload can be in a robot's cache when it is asked for. A robot prepares
payloads only in the form that was asked for last (for its beacon's sizes), and here every round
asks for another error bound (10 cm, 9.99 cm in turn), while each frame is asked for once. The
fastest encoding of the run is reported as proof (`encode_ms_min`).

`python -m benchmarks.roundtrip` simulates a factory of seven robots (the ego and six that it asks);
`--opv2v DIR` uses real 64-ring scans instead: seven robots that share the recorded vehicles' scans.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import write_report
from ego_agent.ask import Asker
from ego_agent.execute import FrameResult, FusionLoop, live_motion
from ego_agent.knowledge import Knowledge
from ego_agent.link import LinkEstimate
from ego_agent.monitor import Monitor
from ego_agent.sense import OwnSensor
from ego_agent.tally import TallyKeeper
from perception.codec.outlined import take_outline
from perception.codec.points import decode_points
from perception.fusion.registry import make_fusion
from swarm.log import make_logger
from swarm.messages import Decision
from swarm.process import Clock
from swarm.session import Session
from worlds.base import World
from worlds.registry import open_world

ROBOTS = 6
WARM_UP = 20
ROUNDS = 210
DEADLINE_S = 1.0
STRIDE = 3
"""Frames from one round to the next: rounds must not queue behind each other here."""
ERROR_BOUNDS_M = (0.1, 0.0999)
PORT = 17447


def recorded_world(data: Path, directory: Path) -> Path:
    """A scenario of seven robots made of links to the recorded vehicles' folders."""
    scenario = next(data.rglob("data_protocol.yaml")).parent
    vehicles = sorted(p for p in scenario.iterdir() if p.is_dir() and any(p.glob("*.pcd")))
    (directory / "data_protocol.yaml").symlink_to(scenario / "data_protocol.yaml")
    for number in range(ROBOTS + 1):
        (directory / f"R{number + 1}").symlink_to(vehicles[number % len(vehicles)])
    return directory


@contextmanager
def processes(env: dict[str, str], robots: tuple[str, ...]) -> Iterator[None]:
    """The router and one process a robot, all gone at the end."""
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stdin": subprocess.DEVNULL}
    python = [sys.executable, "-m"]
    started = [subprocess.Popen([*python, "swarm.router", "--port", str(PORT)], env=env, **quiet)]
    try:
        for robot in robots:
            own = {**env, "COADAPT_ROBOTS": robot}
            started.append(subprocess.Popen([*python, "robot_agent"], env=own, **quiet))
        yield
    finally:
        for process in started:
            process.terminate()
        for process in started:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


def loops(session: Session, world: World, sensor: OwnSensor, monitor: Monitor) -> list[FusionLoop]:
    """The ego's executing half, once for each error bound."""
    log, clock, tally = make_logger("roundtrip", level="warning"), Clock(), TallyKeeper()
    made = []
    for bound in ERROR_BOUNDS_M:
        asker = Asker(
            monitor.ego,
            monitor,
            LinkEstimate(1e9),
            Knowledge(),
            tally,
            clock,
            1.0 / world.rate_hz,
            max_error_m=bound,
            keep_ground=False,
        )
        fusions = {"early": make_fusion("early", world.detector)}
        motion = live_motion(world.detector, world.rate_hz)
        loop = FusionLoop(
            monitor.ego,
            sensor,
            asker,
            fusions,
            motion,
            tally,
            log,
            rate_hz=10.0,
            deadline_s=DEADLINE_S,
        )
        loop.connect(session)
        made.append(loop)
    return made


def run(session: Session, world: World, epoch_ns: int) -> list[FrameResult]:
    """One fused frame a new frame of the world, warm-up left out."""
    ego, *others = world.robots[: ROBOTS + 1]
    log = make_logger("roundtrip", level="warning")
    monitor = Monitor(ego, LinkEstimate(1e9))
    sensor = OwnSensor(world, ego, epoch_ns, monitor, Clock(), log)
    monitor.attach(session)
    both = loops(session, world, sensor, monitor)
    decision = Decision(
        ego=ego,
        cycle=1,
        decided_ns=1,
        participants=(ego, *others),
        algorithm="early",
        reason="benchmark",
        source="policy",
        policy="all",
        valid=True,
    )
    give_up = time.monotonic() + 60.0
    while not all(monitor.is_alive(robot) for robot in others):
        if time.monotonic() > give_up:
            raise SystemExit("roundtrip: the robots did not come up within 60 s")
        time.sleep(0.1)
    results: list[FrameResult] = []
    last = sensor.newest()
    while len(results) < WARM_UP + ROUNDS:
        time.sleep(max(0.0, sensor.until(last + STRIDE)))
        frame = sensor.newest()
        if frame < last + STRIDE:
            continue
        last = frame
        own = sensor.read(frame)
        if own is not None:
            results.append(both[len(results) % 2].fuse(decision, own))
    return results[WARM_UP:]


def decode_cpu_ms(result: FrameResult) -> float:
    """Processor time of decoding the payloads of a frame, measured again on its own."""
    begun = time.thread_time()
    for contribution in result.round.contributions:
        decode_points(take_outline(contribution.payload)[0])
    return (time.thread_time() - begun) * 1e3


def figures(results: list[FrameResult]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures and raw samples of the rounds in which every robot answered."""
    whole = [r for r in results if not r.missing]
    if not whole:
        raise SystemExit(f"roundtrip: no round was complete, e.g. {dict(results[0].missing)}")
    total = np.array([r.latency_ms for r in whole])
    encode = np.array([max(r.round.encode_ms.values()) for r in whole])
    fuse = np.array([r.fuse_ms for r in whole])
    decode_cpu = np.array([decode_cpu_ms(r) for r in whole])
    size = np.array([sum(r.round.bytes.values()) for r in whole])
    parts = {
        "encode_slowest": encode,
        # Decoding is in here: each payload is decoded while slower robots still encode.
        "queue_transfer_decode": total - fuse - encode,
        "detect": fuse,
    }
    summary = {
        "p50_ms": round(float(np.percentile(total, 50)), 2),
        "p95_ms": round(float(np.percentile(total, 95)), 2),
        "p99_ms": round(float(np.percentile(total, 99)), 2),
        "rounds": len(whole),
        "rounds_incomplete": len(results) - len(whole),
        "robots": ROBOTS,
        "bytes_per_round_p50": int(np.median(size)),
        "encode_ms_min": round(min(min(r.round.encode_ms.values()) for r in whole), 2),
        "encode_ms_p50_one_robot": round(
            float(np.median([ms for r in whole for ms in r.round.encode_ms.values()])), 2
        ),
        "decode_cpu_ms_p50": round(float(np.median(decode_cpu)), 2),
        "breakdown_p50_ms": {k: round(float(np.percentile(v, 50)), 2) for k, v in parts.items()},
        "breakdown_p95_ms": {k: round(float(np.percentile(v, 95)), 2) for k, v in parts.items()},
    }
    samples = {"total_ms": total, **{f"{k}_ms": v for k, v in parts.items()}}
    return summary, {k: [round(float(x), 3) for x in v] for k, v in samples.items()}


def main() -> None:
    """Runs the benchmark and writes build/bench/roundtrip.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--opv2v", type=Path, help="directory of the OPV2V sample")
    args = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    epoch_ns = time.time_ns()
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        kind = "opv2v" if args.opv2v else "factory"
        data = recorded_world(args.opv2v, directory) if args.opv2v else None
        env = {
            **os.environ,
            "COADAPT_SWARM": "bench",
            "COADAPT_ROUTER": f"tcp/127.0.0.1:{PORT}",
            "COADAPT_METRICS_PORT": "0",
            "COADAPT_LOG_LEVEL": "warning",
            "COADAPT_EPOCH_NS": str(epoch_ns),
            "COADAPT_WORLD": kind,
            "COADAPT_WORLD_DATA": str(data or ""),
            "COADAPT_WORLD_ROBOTS": str(ROBOTS + 1),
            "COADAPT_WORLD_CACHE": "" if data else str(directory),
        }
        world = open_world(kind, data=data, robots=ROBOTS + 1, cache=None if data else directory)
        with (
            processes(env, world.robots[1 : ROBOTS + 1]),
            Session(env["COADAPT_ROUTER"], "bench", timeout_s=30.0) as session,
        ):
            results = run(session, world, epoch_ns)
    summary, samples = figures(results)
    path = write_report("roundtrip", {"world": kind, **summary}, samples)
    print(f"{path}: p50 {summary['p50_ms']} ms, p95 {summary['p95_ms']} ms")
    print(f"  p50 of the parts: {summary['breakdown_p50_ms']}")


if __name__ == "__main__":
    main()
