"""What fusion and control keep under a flood of telemetry, with classes and without them.

A cell of 5 Mbit/s, level 0. Telemetry sends datagrams at ten times the capacity; a TCP stream with
fusion's mark saturates its class; beacons go through a real router to a subscriber behind the link,
50 a second, and their age on arrival is noted. Then the same with all classes in one queue of the
same rate and length.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from typing import Any

import numpy as np

from deploy.netns.network import run as command
from network_controller import ladder
from network_controller.model import Link
from research.benchmarks.report import write_report
from research.benchmarks.stage import Stage, inside, netns_stage
from swarm import keyspace
from swarm.messages import Beacon
from swarm.session import Session
from swarm.traffic import TrafficClass

CAPACITY_BPS = 5_000_000
FLOOD = 10
SECONDS = 14
SKIPPED = 2
BEACONS_HZ = 50
ROUTER_PORT = 17600
QUEUE_BYTES = 131_072
CELL = Link("R1", "down")


def measure(stage: Stage) -> dict[str, Any]:
    """Bytes of fusion by second, and the ages of beacons, seconds; None for one that is lost."""
    fusion = stage.flow("R2", "R1", SECONDS, tos=TrafficClass.FUSION.tos)
    flood = stage.flow(
        "R3",
        "R1",
        SECONDS,
        tos=TrafficClass.BACKGROUND.tos,
        protocol="udp",
        rate_bps=FLOOD * CAPACITY_BPS,
    )
    listener = stage.start("R1", "research.benchmarks.priority", "--listen")
    assert listener.stdout is not None
    listener.stdout.readline()
    with Session(f"tcp/10.77.0.1:{ROUTER_PORT}", "bench", timeout_s=10) as session:
        sent = 0
        stop = threading.Event()
        end = time.monotonic() + SECONDS - 3 * SKIPPED
        while time.monotonic() < end:
            sent += 1
            session.put(keyspace.beacon("bench", "R2"), beacon(sent))
            stop.wait(1.0 / BEACONS_HZ)
        ages = json.loads(listener.communicate()[0])
    counts = fusion.counts()["bytes"]
    flooded = flood.counts()["bytes"]
    return {"fusion_bytes": counts, "flood_bytes": flooded, "sent": sent, "ages_s": ages}


def listen() -> None:
    """At the robot: the ages of the beacons that come, until the flood is over."""
    ages: list[float] = []
    with Session(f"tcp/10.77.0.1:{ROUTER_PORT}", "bench", timeout_s=30) as session:
        session.subscribe(
            keyspace.beacon("bench", keyspace.ANY),
            Beacon,
            lambda b: ages.append((time.time_ns() - b.sent_ns) / 1e9),
        )
        time.sleep(1.0)
        print("ready", flush=True)
        time.sleep(SECONDS - 2 * SKIPPED)
        print(json.dumps(ages), flush=True)


def beacon(number: int) -> Beacon:
    """A beacon as a robot sends it."""
    now_ns = time.time_ns()
    return Beacon(
        robot="R2",
        instance=1,
        seq=number,
        sent_ns=now_ns,
        capture_ns=now_ns,
        frame=number,
        pose=(1.0, 2.0, 0.5, 0.0, 0.0, 0.1),
        velocity=(1.0, 0.0, 0.0),
        range_m=50.0,
        sizes={"early": 4_000, "late": 200},
    )


def both() -> dict[str, Any]:
    """The two measurements in namespaces of their own."""
    with netns_stage(3) as stage:
        router = stage.start(
            "infra", "swarm.router", "--host", "10.77.0.1", "--port", str(ROUTER_PORT)
        )
        try:
            stage.driver.apply(CELL, ladder.shape(CAPACITY_BPS, 0))
            classes = measure(stage)
            stage.driver.clear(CELL)
            rate = f"{CAPACITY_BPS}bit"
            device = "link1"
            command(*f"tc qdisc add dev {device} root handle 1: htb default 1".split())
            command(*f"tc class add dev {device} parent 1: classid 1:1 htb rate {rate}".split())
            command(
                *f"tc qdisc add dev {device} parent 1:1 bfifo limit {QUEUE_BYTES}".split(),
            )
            single = measure(stage)
        finally:
            router.terminate()
            router.wait()
    return {"classes": classes, "single_queue": single}


def p99_ms(samples: dict[str, Any]) -> float:
    """Of the beacons sent; one that did not come before the end counts as the whole time."""
    lost = max(0, samples["sent"] - len(samples["ages_s"]))
    ages = [*samples["ages_s"], *([float(SECONDS)] * lost)]
    return round(1e3 * float(np.percentile(ages, 99)), 2)


def main() -> int:
    """Measures and writes priority.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--listen", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.listen:
        listen()
        return 0
    if args.inside:
        print(json.dumps(both()))
        return 0
    found = inside("research.benchmarks.priority", "--inside")
    guarantee = ladder.shape(CAPACITY_BPS, 0).classes[TrafficClass.FUSION].rate_bps

    def fusion_bps(samples: dict[str, Any]) -> float:
        whole = samples["fusion_bytes"][SKIPPED:-SKIPPED]
        return 8.0 * float(np.mean(whole))

    figures = {
        "fusion_guarantee_ratio": round(fusion_bps(found["classes"]) / guarantee, 3),
        "control_p99_ms": p99_ms(found["classes"]),
        "control_p99_ms_single_queue": p99_ms(found["single_queue"]),
        "fusion_guarantee_ratio_single_queue": round(
            fusion_bps(found["single_queue"]) / guarantee, 3
        ),
        "control_p50_ms": round(1e3 * float(np.median(found["classes"]["ages_s"])), 2),
        "control_lost": found["classes"]["sent"] - len(found["classes"]["ages_s"]),
        "control_lost_single_queue": found["single_queue"]["sent"]
        - len(found["single_queue"]["ages_s"]),
        "capacity_bps": CAPACITY_BPS,
        "guarantee_bps": guarantee,
        "flood_times_capacity": FLOOD,
    }
    print(
        f"priority: fusion has {figures['fusion_guarantee_ratio']} of its guarantee, control p99 "
        f"{figures['control_p99_ms']} ms ({figures['control_p99_ms_single_queue']} in one queue)"
    )
    write_report("priority", figures, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
