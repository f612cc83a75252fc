"""How well a link follows a recorded trace.

The network controller itself follows the trace on one cell, second by second, while datagrams with
fusion's mark are sent at more than the trace's highest rate, so that the link is the limit all the
time. What arrives in each second, with headers, is held against the trace's capacity in it.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from prometheus_client import CollectorRegistry

from network_controller.controller import Controller
from network_controller.mahimahi import read_trace
from network_controller.metrics import ControllerMetrics
from network_controller.slow_loop import SlowLoop
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wishes
from research.benchmarks.flow import DATAGRAM, DATAGRAM_FRAME
from research.benchmarks.report import write_report
from research.benchmarks.stage import inside, netns_stage
from swarm.errors import WorldError
from swarm.log import make_logger
from swarm.messages import ShapeRequest
from swarm.traffic import TrafficClass
from worlds.sample import data_folder

NAME = "Verizon-LTE-short.down"
SECONDS = 60
SATURATING = 1.2


def trace_path(name: str) -> Path:
    """A recorded trace in the data folder (worlds.sample). Raises WorldError."""
    folder = data_folder(Path("traces"))
    if folder is not None and (folder / name).is_file():
        return folder / name
    raise WorldError(
        f"no recorded trace: set COADAPT_DATA to a directory with traces/{name}, or name one with "
        "--trace FILE"
    )


def follow(rates_bps: tuple[int, ...]) -> dict[str, Any]:
    """Payload bytes by second while a controller follows the rates."""
    with netns_stage(2) as stage:
        controller = Controller(
            stage.driver,
            Wishes(None, 0),
            SlowLoop(),
            Flows(stage.driver),
            ControllerMetrics(CollectorRegistry()),
            None,
            make_logger("trace"),
            ego="R1",
        )
        controller.start()
        stop = threading.Event()
        worker = threading.Thread(target=controller.run, args=(stop, lambda states: None))
        worker.start()
        try:
            # A second before the trace's first one: the flow is there when it begins.
            lead = (rates_bps[0], *rates_bps)
            flow = stage.flow(
                "R2",
                "R1",
                len(lead) + 1,
                tos=TrafficClass.FUSION.tos,
                protocol="udp",
                rate_bps=SATURATING * max(rates_bps),
            )
            begun_ns = time.time_ns()
            controller.request(
                ShapeRequest(profile="trace", rates_bps=lead, duration_s=len(lead) + 10.0)
            )
            counts = flow.counts()
        finally:
            stop.set()
            controller.wake()
            worker.join()
            controller.close()
    return {"trace_began_ns": begun_ns, **counts}


def main() -> int:
    """Measures and writes trace.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trace", type=Path)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    try:
        path = args.trace or trace_path(NAME)
    except WorldError as error:
        print(f"trace: left out: {error}", file=sys.stderr)
        return 0
    rates_bps = read_trace(path)[:SECONDS]
    if args.inside:
        print(json.dumps(follow(rates_bps)))
        return 0
    found = inside("research.benchmarks.trace", "--inside", "--trace", str(path))
    late_s = (found["trace_began_ns"] - found["begun_ns"]) / 1e9
    frames = np.array(found["bytes"]) * (DATAGRAM_FRAME / DATAGRAM)
    # The flow's seconds do not begin with the trace's: take what came in each of the trace's, as if
    # a second's bytes had come evenly.
    edges = np.arange(len(frames) + 1)
    total = np.concatenate([[0.0], np.cumsum(frames)])
    wanted = late_s + 1.0 + np.arange(len(rates_bps) + 1)
    delivered_bps = 8.0 * np.diff(np.interp(wanted, edges, total))
    recorded_bps = np.array(rates_bps, dtype=float)
    whole = wanted[1:] <= len(frames)
    error_bps = np.abs(delivered_bps - recorded_bps)[whole]
    figures = {
        "mean_abs_error_ratio": round(float(error_bps.mean() / recorded_bps[whole].mean()), 4),
        "median_error_ratio": round(float(np.median(error_bps / recorded_bps[whole])), 4),
        "seconds": int(whole.sum()),
        "trace": path.name,
        "recorded_mean_bps": round(float(recorded_bps[whole].mean())),
    }
    print(
        f"trace: {figures['seconds']} s of {path.name}, mean error "
        f"{100 * figures['mean_abs_error_ratio']:.1f} % of the recorded capacity"
    )
    samples = {
        "recorded_bps": [int(x) for x in recorded_bps],
        "delivered_bps": [int(x) for x in delivered_bps],
    }
    write_report("trace", figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
