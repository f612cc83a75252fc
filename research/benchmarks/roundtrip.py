"""Observation round trip: from the ego's first query to the fused boxes, over real processes.

What `make up ROBOTS=6` starts to perceive with: a router, six robots, each a `robot_agent` process
of its own, and the ego, with the settings that `coadapt up` gives them, joined over loopback TCP
that nothing shapes (no console, network controller or Prometheus). The ego follows `static-early`
and so on: it asks the five others for every frame of its 10 Hz and waits 0.25 s at most. Robots
sense at 10 Hz, send beacons and describe their scenes as always. All share this machine's cores,
which robots would not. The figures at the top level are those of early fusion; `rows` holds those
of other algorithms, and of early fusion beside a process that keeps one core busy.

Encoding is included: each frame is asked for once, and what a robot has answered is not measured
for its beacon. The fastest encoding of the run is reported as proof (`encode_ms_min`).

`python -m research.benchmarks.roundtrip` simulates a factory; `--opv2v DIR` uses real 64-ring scans
instead: six robots that share the recorded vehicles' scans.
"""

from __future__ import annotations

import argparse
import json
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

from deploy.ports import LOCALHOST
from deploy.roster import Place, Service
from deploy.services import services
from deploy.spec import SwarmSpec, factory_robots, make_spec
from research.benchmarks.ending import signals_raise
from research.benchmarks.processes import free_ports
from research.benchmarks.report import write_report
from swarm.listening import Handlers, listen
from swarm.messages import Decision

ROBOTS = 6
SECONDS = 22.0
"""Of each run."""
START_S = 120.0
"""How long an ego may take until its robots answer."""
ALGORITHMS = ("early", "intermediate-codebook", "late")
EVERYBODY_M = 500.0
BUSY = "while True: pass"

Frames = list[dict[str, Any]]


def recorded_world(data: Path, directory: Path) -> Path:
    """A scenario of six robots made of links to the recorded vehicles' folders."""
    scenario = next(data.rglob("data_protocol.yaml")).parent
    vehicles = sorted(p for p in scenario.iterdir() if p.is_dir() and any(p.glob("*.pcd")))
    (directory / "data_protocol.yaml").symlink_to(scenario / "data_protocol.yaml")
    for number, robot in enumerate(factory_robots(ROBOTS)):
        (directory / robot).symlink_to(vehicles[number % len(vehicles)])
    return directory


def swarm_spec(kind: str, data: Path | None, directory: Path) -> SwarmSpec:
    """The swarm as `make up` would describe it, on ports that are free."""
    return make_spec(
        swarm="bench-roundtrip",
        robots=factory_robots(ROBOTS),
        world=kind,
        data=str(data or ""),
        comm_range_m=EVERYBODY_M,
        router_port=free_ports(3),
        epoch_ns=time.time_ns(),
        run_dir=str(directory),
        var_dir=str(directory),
    )


class Swarm:
    """The processes of one swarm on this machine."""

    def __init__(self, spec: SwarmSpec, data: Path | None, directory: Path) -> None:
        place = Place(
            listen_host=LOCALHOST,
            router_host=LOCALHOST,
            var_dir=str(directory),
            prometheus_config="",
            data=str(data or ""),
            python=sys.executable,
        )
        self.address = f"tcp/{LOCALHOST}:{spec.router_port}"
        self.spec = spec
        self._services = {service.name: service for service in services(spec, place)}

    @contextmanager
    def running(self) -> Iterator[None]:
        """The router and the robots, all gone at the end."""
        names = ["router", *(f"robot-{robot}" for robot in self.spec.robots)]
        started = [self._start(self._services[name]) for name in names]
        try:
            yield
        finally:
            end(*started)

    def frames(self, algorithm: str, path: Path) -> Frames:
        """What an ego fuses in SECONDS that chooses everybody with that algorithm."""
        ego = self._services[f"ego-{self.spec.ego}"]
        argv = (sys.executable, "-m", "research.benchmarks.roundtrip_ego", str(path), str(SECONDS))
        chosen = {"COADAPT_POLICY": f"static-{algorithm}", "COADAPT_JOURNAL": ""}
        process = self._start(ego, argv, chosen)
        try:
            process.wait(START_S + SECONDS)
            found: Frames = json.loads(path.read_text())
        except (subprocess.TimeoutExpired, OSError, ValueError):
            raise SystemExit(f"roundtrip: no frames of {algorithm} in {START_S:.0f} s") from None
        finally:
            end(process)
        return found

    def _start(
        self, service: Service, argv: tuple[str, ...] = (), chosen: dict[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        own = {"COADAPT_METRICS_PORT": "0", "COADAPT_METRICS_HOST": LOCALHOST}
        words = list(argv or service.argv)
        if "--metrics-port" in words:
            words[words.index("--metrics-port") + 1] = "0"
        return subprocess.Popen(
            words,
            env={
                **os.environ,
                **service.env,
                **own,
                "COADAPT_LOG_LEVEL": "error",
                **(chosen or {}),
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )


def end(*processes: subprocess.Popen[bytes]) -> None:
    """Ends processes, by force where they do not."""
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()


def row(algorithm: str, load: int, frames: Frames, decisions: list[Decision]) -> dict[str, Any]:
    """The figures of one run. A robot that no frame asked is missing, too."""
    if not frames:
        raise SystemExit(f"roundtrip: no frame of {algorithm} was fused")
    others = ROBOTS - 1
    latency = np.array([frame["latency_ms"] for frame in frames])
    age = np.array([frame["age_ms"] for frame in frames])
    shares = {
        robot: sum(robot in frame["participants"] for frame in frames)
        / max(1, sum(robot in frame["due"] for frame in frames))
        for robot in factory_robots(ROBOTS)[1:]
    }
    contributions = sum(len(frame["participants"]) for frame in frames)
    kinds = [kind for frame in frames for kind in frame["missing"].values()]
    return {
        "algorithm": algorithm,
        "load": load,
        "p50_ms": _percentile(latency, 50),
        "p95_ms": _percentile(latency, 95),
        "fps": round(len(frames) / SECONDS, 2),
        "contributions_hz": round(contributions / others / SECONDS, 2),
        "missing_ratio": round(1.0 - sum(shares.values()) / others, 4),
        "age_p50_ms": _percentile(age, 50),
        "age_p95_ms": _percentile(age, 95),
        "least_in_time_ratio": round(min(shares.values()), 4),
        "missing": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "decisions": len(decisions),
        "decisions_invalid": sum(not decision.valid for decision in decisions),
    }


def details(frames: Frames) -> tuple[dict[str, Any], dict[str, Any]]:
    """Where the time of the rounds goes in which everyone asked answered, and their raw samples."""
    whole = [frame for frame in frames if frame["due"] == sorted(frame["participants"]) != []]
    if not whole:
        return {"rounds": 0, "rounds_incomplete": len(frames)}, {}
    total = np.array([frame["latency_ms"] for frame in whole])
    slowest = np.array([max(frame["encode_ms"].values()) for frame in whole])
    detect = np.array([frame["fuse_ms"] for frame in whole])
    parts = {
        "encode_slowest": slowest,
        # Decoding is in here: each payload is decoded while slower robots still encode.
        "queue_transfer_decode": total - detect - slowest,
        "detect": detect,
        "wait_for_frame_before": np.array([frame["wait_ms"] for frame in whole]),
        "take_up": np.array([frame["add_ms"] for frame in whole]),
    }
    encodings = [ms for frame in whole for ms in frame["encode_ms"].values()]
    decoding = [frame["decode_cpu_ms"] for frame in frames if "decode_cpu_ms" in frame]
    figures = {
        "p99_ms": _percentile(total, 99),
        "rounds": len(whole),
        "rounds_incomplete": len(frames) - len(whole),
        "bytes_per_round_p50": int(np.median([frame["bytes"] for frame in whole])),
        "encode_ms_min": round(min(encodings), 2),
        "encode_ms_p50_one_robot": round(float(np.median(encodings)), 2),
        "decode_cpu_ms_p50": round(float(np.median(decoding)), 2) if decoding else None,
        "breakdown_p50_ms": {name: _percentile(v, 50) for name, v in parts.items()},
        "breakdown_p95_ms": {name: _percentile(v, 95) for name, v in parts.items()},
    }
    samples = {"total_ms": total, **{f"{name}_ms": v for name, v in parts.items()}}
    return figures, {name: [round(float(x), 3) for x in v] for name, v in samples.items()}


def _percentile(values: np.ndarray[Any, np.dtype[np.float64]], share: float) -> float:
    return round(float(np.percentile(values, share)), 2)


def run(swarm: Swarm, directory: Path) -> tuple[list[dict[str, Any]], Frames]:
    """A row a run, and the frames of the first one."""
    rows: list[dict[str, Any]] = []
    first: Frames = []
    decisions: list[Decision] = []
    handlers: Handlers = {Decision: decisions.append}
    spec = swarm.spec
    with swarm.running(), listen(swarm.address, spec.swarm, handlers, spec.ego, timeout_s=30.0):
        for algorithm, load in [*((name, 0) for name in ALGORITHMS), (ALGORITHMS[0], 1)]:
            decisions.clear()
            busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(load)]
            try:
                frames = swarm.frames(algorithm, directory / f"{algorithm}-{load}.json")
            finally:
                end(*busy)
            rows.append(row(algorithm, load, frames, list(decisions)))
            print(f"  {rows[-1]}", flush=True)
            first = first or frames
    return rows, first


def main() -> None:
    """Runs the benchmark and writes build/bench/roundtrip.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--opv2v", type=Path, help="directory of the OPV2V sample")
    args = parser.parse_args()
    with signals_raise(), tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        kind = "opv2v" if args.opv2v else "factory"
        data = recorded_world(args.opv2v, directory) if args.opv2v else None
        rows, frames = run(Swarm(swarm_spec(kind, data, directory), data, directory), directory)
    parts, samples = details(frames)
    early = {key: value for key, value in rows[0].items() if key not in ("algorithm", "load")}
    figures = {"world": kind, "robots": ROBOTS, **early, **parts, "rows": rows}
    path = write_report("roundtrip", figures, samples)
    print(f"{path}: p50 {early['p50_ms']} ms, p95 {early['p95_ms']} ms, {early['fps']} frames/s")


if __name__ == "__main__":
    main()
