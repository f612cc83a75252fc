"""A plain `zenoh get` of the same bytes against our asking, which sends answers in parts as far as
the asker's credit goes.

A robot's host serves both; the asker is at another host; a router between them. Over links that
nothing shapes, and over one of SHAPED_BPS. Latency is that of one answer at a time, in turn;
throughput that of LARGE bytes.

`python -m research.benchmarks.peers.zenoh_get route|serve|ask`: one of the processes.
"""

from __future__ import annotations

import argparse
import itertools
import json
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import zenoh

from deploy.netns.network import BRIDGE_ADDRESS
from network_controller import ladder
from network_controller.model import Link
from research.benchmarks.intervals import ratio_of_medians
from research.benchmarks.stage import Stage, inside, netns_stage
from swarm import keyspace, transport
from swarm.errors import TransportError
from swarm.messages import Observation, ObservationRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

ROUTER_PORT, STOCK_PORT = 17620, 17630
ROUTER = f"tcp/{BRIDGE_ADDRESS}:{ROUTER_PORT}"
SWARM, ASKER, SERVER = "bench", "R1", "R2"
SIZES = (12_000, 200_000)
"""Of a payload: of points as early fusion sends them, and of a large feature map."""
LARGE = 700_000
SHAPED_BPS = 20_000_000
ROUNDS, LARGE_ROUNDS = 40, 8
TIMEOUT_S = 20.0
KEY = "plain"
CLIENT = ("client", "connect/endpoints")


def measure() -> tuple[dict[str, Any], dict[str, Any]]:
    """`ratio_zenoh_get_*`: our latency, and our throughput, over a plain get's; samples."""
    found: dict[str, dict[str, dict[str, list[float]]]] = inside(
        "research.benchmarks.peers.zenoh_get", "all"
    )
    figures: dict[str, Any] = {}
    rows = []
    for link, by_size in found.items():
        for size, times in by_size.items():
            ratio, interval = ratio_of_medians(times["ours_ms"], times["plain_ms"])
            row = {"link": link, "bytes": int(size), "n": len(times["ours_ms"])}
            row |= {f"{way}_p50": round(float(np.median(ms)), 3) for way, ms in times.items()}
            if int(size) == LARGE:
                low, high = interval
                interval = (round(1.0 / high, 4), round(1.0 / low, 4))
                row |= {"ratio_throughput": round(1.0 / ratio, 4), "ratio_interval": interval}
                figures[f"ratio_zenoh_get_throughput_{link}"] = row["ratio_throughput"]
            else:
                row |= {"ratio_latency": ratio, "ratio_interval": interval}
                figures[f"ratio_zenoh_get_latency_{link}_{size}"] = ratio
            rows.append(row)
    return figures | {"zenoh_get": {"rows": rows, "shaped_bps": SHAPED_BPS}}, found


def run_all(stage: Stage) -> dict[str, Any]:
    """Both links' times, by size and way. The processes end with their namespace."""
    stage.start("infra", "swarm.router", "--host", BRIDGE_ADDRESS, "--port", str(ROUTER_PORT))
    _started(stage, "infra", "route")
    _started(stage, SERVER, "serve")
    found = {}
    for name, rate_bps in (("unshaped", None), ("20mbit", SHAPED_BPS)):
        if rate_bps is not None:
            stage.driver.apply(Link(ASKER, "down"), ladder.shape(rate_bps, 0))
        asker = stage.start(ASKER, "research.benchmarks.peers.zenoh_get", "ask")
        found[name] = json.loads(asker.communicate()[0])
    return found


def _started(stage: Stage, host: str, role: str) -> None:
    process = stage.start(host, "research.benchmarks.peers.zenoh_get", role)
    assert process.stdout is not None
    process.stdout.readline()


def stock(mode: str, place: str) -> zenoh.Session:
    """A session as Zenoh makes it by itself, but for the mark that the shaped link looks at."""
    endpoint = f"tcp/{BRIDGE_ADDRESS}:{STOCK_PORT}#dscp={TrafficClass.FUSION.tos:#04x}"
    config = {"mode": mode, place: [endpoint], "scouting/multicast/enabled": False}
    return transport.open_zenoh(config, timeout_s=TIMEOUT_S)


def route() -> None:
    """A stock router."""
    with stock("router", "listen/endpoints"):
        print("ready", flush=True)
        threading.Event().wait()


def serve() -> None:
    """Answers both ways, as many bytes as are asked for."""
    data = np.random.default_rng(0).integers(0, 256, LARGE, dtype=np.uint8).tobytes()

    def observe(request: ObservationRequest) -> Observation:
        return Observation(
            robot=SERVER,
            instance=1,
            request=request.request,
            algorithm=request.algorithm,
            capture_ns=1,
            frame=1,
            pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            payload=data[: request.max_bytes],
            encode_ms=0.0,
        )

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(KEY, data[: int(query.parameters.get("bytes") or 0)])

    with Session(ROUTER, SWARM, timeout_s=TIMEOUT_S) as ours, stock(*CLIENT) as plain:
        ours.serve(keyspace.observation(SWARM, SERVER), ObservationRequest, observe)
        queryable = plain.declare_queryable(KEY, answer, complete=True)
        print("ready", flush=True)
        threading.Event().wait()
        queryable.undeclare()  # type: ignore[no-untyped-call]


def ask() -> None:
    """Milliseconds of each way by size, in turn."""
    with Session(ROUTER, SWARM, timeout_s=TIMEOUT_S) as session, stock(*CLIENT) as plain:
        numbers = itertools.count()

        def ours(size: int) -> None:
            request = ObservationRequest(
                ego=ASKER,
                request=next(numbers),
                algorithm="early",
                capture_ns=0,
                max_bytes=size,
            )
            key = keyspace.observation(SWARM, SERVER)
            answer = session.ask(key, request, Observation, timeout_s=TIMEOUT_S).result()
            _check(len(answer.message.payload), size)

        def theirs(size: int) -> None:
            replies = plain.get(f"{KEY}?bytes={size}", timeout=TIMEOUT_S)
            got = [len(reply.ok.payload) for reply in replies if reply.ok is not None]
            _check(sum(got), size)

        ways = {"ours_ms": ours, "plain_ms": theirs}
        for way in ways.values():
            _until_served(way)
        found = {}
        for size in (*SIZES, LARGE):
            times: dict[str, list[float]] = {name: [] for name in ways}
            for _ in range(LARGE_ROUNDS if size == LARGE else ROUNDS):
                for name, way in ways.items():
                    begun = time.perf_counter()
                    way(size)
                    times[name].append(round((time.perf_counter() - begun) * 1e3, 3))
            found[size] = times
    print(json.dumps(found), flush=True)


def _check(got: int, size: int) -> None:
    if got != size:
        raise TransportError(f"{got} bytes came, {size} were asked for")


def _until_served(way: Callable[[int], None]) -> None:
    """Asks until the queryable has reached this session."""
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        try:
            way(SIZES[0])
            return
        except TransportError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def main() -> None:
    """One of the processes, or all of them in namespaces of their own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("all", "route", "serve", "ask"))
    what = parser.parse_args().what
    if what == "all":
        with netns_stage(2) as stage:
            print(json.dumps(run_all(stage)))
    else:
        {"route": route, "serve": serve, "ask": ask}[what]()


if __name__ == "__main__":
    main()
