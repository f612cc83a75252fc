"""What identity costs: mutual TLS and access control beside a plain router, in one run.

An ego asks a robot for answers of 200 kB through a router, four at a time: over TCP, over mutual
TLS with a rule that lets everything pass, and with the rules of a swarm. The three take turns, and
the processor time of router, robot and ego is counted. Beside that: how long a session takes to
open, what 300 MB on a beacon's key cost the router, how many questions an impostor answers, and
every role against every key and act (`rights_matrix`).
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import zenoh

from deploy.trust.keystore import Keystore
from research.benchmarks.controller import cpu_s
from research.benchmarks.report import write_report
from research.benchmarks.rights_matrix import ACTS, KEYS, ROLES, open_site, wrong
from swarm import keyspace, transport, zenoh_config
from swarm.asking import Answer
from swarm.errors import TransportError
from swarm.messages import Observation, ObservationRequest
from swarm.session import Session
from swarm.trust.access import access_control
from swarm.trust.members import Trust, read_members
from swarm.trust.roles import LOCAL

SWARM, ROBOT, EGO = "bench", "R3", "ego-R1"
FIRST_PORT = 17640
ANSWER_BYTES = 200_000
AT_A_TIME = 4
SECONDS, ROUNDS = 3.0, 6
OPENED = 20
ASKED = 40
OVERSIZE_BYTES = 300_000_000
WAYS = ("plain", "tls", "secure")


def address(store: Keystore, way: str, name: str) -> str:
    """The router of one way for a role."""
    port = FIRST_PORT + 10 * WAYS.index(way)
    if way == "plain":
        return f"tcp/127.0.0.1:{port}"
    return f"tls/127.0.0.1:{port}#identity={store.identity(name).folder}"


def route(way: str, keystore: str) -> None:
    """A router of one way, until standard input ends."""
    router = Keystore(Path(keystore)).identity("router")
    port = FIRST_PORT + 10 * WAYS.index(way)
    access = access_control(SWARM, read_members(router), LOCAL)
    if way == "tls":
        access = {"enabled": False}
    trust = None if way == "plain" else Trust(router, access)
    session = transport.open_zenoh(zenoh_config.router_config("127.0.0.1", port, None, trust))
    print("ready", flush=True)
    sys.stdin.read()
    transport.close_zenoh(session)


def serve(way: str, keystore: str) -> None:
    """A robot that answers, until standard input ends."""
    answer = Observation(
        robot=ROBOT,
        request=0,
        algorithm="early",
        frame=0,
        capture_ns=0,
        pose=(0.0,) * 6,
        payload=os.urandom(ANSWER_BYTES),
        instance=1,
        encode_ms=0.0,
    )
    router = address(Keystore(Path(keystore)), way, ROBOT)
    with Session(router, SWARM, timeout_s=20.0) as session:
        key = keyspace.observation(SWARM, ROBOT)
        session.serve(key, ObservationRequest, lambda _: answer, workers=AT_A_TIME + 1)
        print("ready", flush=True)
        sys.stdin.read()


@contextmanager
def running(part: str, way: str, store: Keystore) -> Iterator[subprocess.Popen[str]]:
    """This module as a process that plays one part."""
    argv = [sys.executable, "-m", "research.benchmarks.trust", part, way, str(store.folder)]
    with subprocess.Popen(argv, stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        process.stdout.readline()
        try:
            yield process
        finally:
            process.stdin.close()
            process.wait(20)


def asked(session: Session, number: int, timeout_s: float) -> Future[Answer[Observation]]:
    """One question to the robot."""
    request = ObservationRequest(ego="R1", request=number, algorithm="early", capture_ns=0)
    key = keyspace.observation(SWARM, ROBOT)
    return session.ask(key, request, Observation, timeout_s=timeout_s)


def flow(session: Session, pids: list[int]) -> tuple[float, float]:
    """Bytes a second, and seconds of processor time a gigabyte, of this process and others."""
    pending: set[Future[Answer[Observation]]] = set()
    moved, number = 0, 0
    own, used = time.process_time(), sum(map(cpu_s, pids))
    begun = time.monotonic()
    while time.monotonic() < begun + SECONDS:
        while len(pending) < AT_A_TIME:
            number += 1
            pending.add(asked(session, number, 10.0))
        done, pending = wait(pending, return_when=FIRST_COMPLETED)
        moved += sum(answer.result().wire_bytes for answer in done)
    seconds = time.monotonic() - begun
    wait(pending)
    spent = time.process_time() - own + sum(map(cpu_s, pids)) - used
    moved += sum(answer.result().wire_bytes for answer in pending)
    return moved / seconds, spent / moved * 1e9


def until_answered(session: Session) -> None:
    """The router has heard of the robot."""
    for number in range(40):
        with suppress(TransportError):
            asked(session, number, 0.5).result()
            return
    raise TransportError(f"{ROBOT} does not answer")


def opening_ms(router: str) -> list[float]:
    """How long sessions take to open with all their links."""
    found = []
    for _ in range(OPENED):
        begun = time.perf_counter()
        with Session(router, SWARM, timeout_s=20.0):
            found.append(1e3 * (time.perf_counter() - begun))
    return found


def oversize_mb(router: str, pid: int) -> float:
    """By how much the router's memory grows with one message that is far too large."""
    before = resident_mb(pid)
    with Session(router, SWARM, timeout_s=20.0) as session, suppress(zenoh.ZError):
        session._connection.zenoh.put(
            keyspace.beacon(SWARM, ROBOT),
            bytes(OVERSIZE_BYTES),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
    time.sleep(2.0)
    return resident_mb(pid) - before


def resident_mb(pid: int) -> float:
    """The most memory that a process has held."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024


def impostor_answers(store: Keystore) -> int:
    """Of `ASKED` questions to a robot, how many another one answers that serves its key."""
    with (
        running("route", "secure", store),
        Session(address(store, "secure", "R2"), SWARM, timeout_s=20.0) as impostor,
        Session(address(store, "secure", EGO), SWARM, timeout_s=20.0) as ego,
    ):
        taken: list[int] = []

        def answer(request: ObservationRequest) -> Observation:
            taken.append(request.request)
            raise TransportError("taken")

        impostor.serve(keyspace.observation(SWARM, ROBOT), ObservationRequest, answer)
        for number in range(ASKED):
            with suppress(TransportError):
                asked(ego, number, 0.2).result()
        return len(taken)


def matrix() -> tuple[int, int]:
    """How many cells were tried, and how many were wrong."""
    with tempfile.TemporaryDirectory() as folder, open_site(Path(folder), FIRST_PORT + 40) as site:
        bad = sum(len(wrong(site, role, act)) for role in ROLES for act in ACTS)
    return len(ROLES) * len(ACTS) * len(KEYS), bad


def measure(store: Keystore) -> tuple[dict[str, Any], dict[str, Any]]:
    """The figures and their samples."""
    rates: dict[str, list[float]] = {way: [] for way in WAYS}
    costs: dict[str, list[float]] = {way: [] for way in WAYS}
    opened: dict[str, list[float]] = {}
    with ExitStack() as stack:
        routers = {way: stack.enter_context(running("route", way, store)) for way in WAYS}
        robots = {way: stack.enter_context(running("serve", way, store)) for way in WAYS}
        egos = {
            way: stack.enter_context(Session(address(store, way, EGO), SWARM, timeout_s=20.0))
            for way in WAYS
        }
        for session in egos.values():
            until_answered(session)
        for _ in range(ROUNDS):
            for way in WAYS:
                rate, cost = flow(egos[way], [routers[way].pid, robots[way].pid])
                rates[way].append(rate)
                costs[way].append(cost)
        for way in WAYS:
            opened[way] = opening_ms(address(store, way, EGO))
        router = routers["secure"].pid
        grown = oversize_mb(address(store, "secure", ROBOT), router)

    def ratio(samples: dict[str, list[float]], way: str) -> float:
        pairs = zip(samples[way], samples["plain"], strict=True)
        return round(statistics.median(one / plain for one, plain in pairs), 3)

    def median(samples: dict[str, list[float]], way: str) -> float:
        return statistics.median(samples[way])

    cells, bad = matrix()
    figures = {
        "throughput_ratio": ratio(rates, "secure"),
        "throughput_ratio_tls_only": ratio(rates, "tls"),
        "cpu_ratio": ratio(costs, "secure"),
        "cpu_ratio_tls_only": ratio(costs, "tls"),
        "session_open_ms_ratio": round(median(opened, "secure") / median(opened, "plain"), 2),
        "session_open_ms": {way: round(median(opened, way), 1) for way in WAYS},
        "acl_matrix_cells": cells,
        "acl_matrix_wrong": bad,
        "oversize_rss_mb": round(grown, 1),
        "impostor_answers": impostor_answers(store),
        "impostor_asked": ASKED,
    }
    samples = {"bytes_per_s": rates, "cpu_s_per_gb": costs, "open_ms": opened}
    return figures, samples


def main() -> int:
    """Measures and writes trust.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", nargs="?", help=argparse.SUPPRESS)
    parser.add_argument("way", nargs="?", help=argparse.SUPPRESS)
    parser.add_argument("keystore", nargs="?", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.part:
        {"route": route, "serve": serve}[args.part](args.way, args.keystore)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        store = Keystore(Path(folder) / "keystore")
        store.init(SWARM)
        store.issue("router", ("127.0.0.1",))
        for name in (ROBOT, "R2", EGO):
            store.issue(name)
        figures, samples = measure(store)
    path = write_report("trust", figures, samples)
    print(f"{path}: {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
