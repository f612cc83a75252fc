"""A slow link in namespaces of its own.

`python -m tests.support.slow_link PLAN` prints what an ego saw.

Must be run in a new network and process namespace (`see_slow_link` does so, and all of it goes with
the process): a router and some servers at the near end of a veth pair, whose near end is shaped,
and an ego in a network namespace at the far end, which asks every server at once.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from contextlib import ExitStack
from typing import IO, Any

import msgspec

from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.netstate import LinkWatch
from robot_agent.duty import OBSERVE_WORKERS
from swarm import keyspace
from swarm.messages import Beacon, Observation, ObservationRequest, TcpState
from swarm.session import Answer, Session
from swarm.traffic import TrafficClass
from tests.support.message_samples import SAMPLES
from tests.support.paths import REPOSITORY

NEAR, FAR, PORT = "10.78.0.1", "10.78.0.2", 7447
ROUTER = f"tcp/{NEAR}:{PORT}"
SWARM = "slow"
QUEUE_BYTES = 128 * 1024
SMALL_TIMEOUT_S = 20.0
BEACON_PERIOD_S = 0.1
LIMIT_S = 60.0
PRIOR_BPS = 55e6
_UNSHARE = (
    *("unshare", "--user", "--map-root-user", "--net", "--mount"),
    *("--pid", "--fork", "--kill-child", "--mount-proc"),
)
_SELF = (sys.executable, "-m", "tests.support.slow_link")
BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))


class Plan(msgspec.Struct, frozen=True):
    """What the ego asks over which link."""

    servers: int
    answer_bytes: int
    timeout_s: float
    rate_bps: int
    later_bps: int | None = None
    """The rate once the first part of an answer may be on its way."""


class Seen(msgspec.Struct, frozen=True):
    """What came of it."""

    errors: list[str]
    """Of the large answers."""
    answers: list[int]
    """Their wire bytes."""
    waited_s: float
    """Until the last of them was there or had failed."""
    small: list[str | int]
    """Of a small question to every server right afterwards: its error or its wire bytes."""
    left: list[str]
    """Servers whose liveliness token was lost."""
    fewest_links: int
    reopened: int
    beacons: int
    """That came while the large answers were under way, of all servers."""
    capacity_bps: float = 0.0
    """Median of C(t) in the second half of the wait, by the router's word alone."""
    fusion_bytes: int = 0
    """What the link carried for the fusion class until the small questions were answered."""


def see_slow_link(plan: Plan) -> Seen:
    """Runs a plan in new namespaces."""
    done = subprocess.run(
        [*_UNSHARE, *_SELF, msgspec.json.encode(plan).decode()],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return msgspec.json.decode(done.stdout, type=Seen)


def run(*argv: str, text: str = "") -> str:
    return subprocess.run(argv, input=text, capture_output=True, text=True, check=True).stdout


def shape(rate_bps: int, verb: str = "replace") -> None:
    """HTB with a class a traffic class, by DSCP, on what leaves the near end."""
    lines = [f"class {verb} dev near parent 1: classid 1:1 htb rate {rate_bps}bit"]
    if verb == "add":
        lines.insert(0, "qdisc add dev near root handle 1: htb default 30")
    for number, (traffic, share) in enumerate(zip(TrafficClass, (0.1, 0.8, 0.1), strict=True)):
        handle = 10 * (number + 1)
        lines.append(
            f"class {verb} dev near parent 1:1 classid 1:{handle} htb prio {number} "
            f"rate {int(rate_bps * share)}bit ceil {rate_bps}bit"
        )
        if verb == "add":
            lines += [
                f"qdisc add dev near parent 1:{handle} handle {handle}: bfifo limit {QUEUE_BYTES}",
                f"filter add dev near parent 1: protocol ip prio {number + 1} u32 "
                f"match ip dsfield {traffic.tos:#04x} 0xfc flowid 1:{handle}",
            ]
    run("tc", "-batch", "-", text="\n".join(lines))


def fusion_bytes() -> int:
    """What the fusion class has sent."""
    qdiscs = json.loads(run("tc", "-j", "-s", "qdisc", "show", "dev", "near"))
    return next(int(q["bytes"]) for q in qdiscs if q["handle"] == "20:")


def serve(name: str, plan: Plan, stack: ExitStack) -> None:
    """A server that answers the first request largely and beacons at 10 Hz."""
    session = stack.enter_context(Session(ROUTER, SWARM, timeout_s=LIMIT_S))
    large, gone = os.urandom(plan.answer_bytes), threading.Event()

    def handle(request: ObservationRequest) -> Observation:
        return Observation(
            robot=name,
            instance=1,
            request=request.request,
            algorithm=request.algorithm,
            capture_ns=1,
            frame=1,
            pose=(0.0,) * 6,
            payload=large if request.request == 1 else b"small",
            encode_ms=1.0,
        )

    def beacon() -> None:
        while not gone.wait(BEACON_PERIOD_S):
            session.put(keyspace.beacon(SWARM, name), msgspec.structs.replace(BEACON, robot=name))

    key = keyspace.observation(SWARM, name)
    session.serve(key, ObservationRequest, handle, workers=OBSERVE_WORKERS, newest_first=True)
    session.declare_alive(name)
    thread = threading.Thread(target=beacon)
    thread.start()
    stack.callback(thread.join)
    stack.callback(gone.set)


def ask_all(plan: Plan) -> None:
    """The ego: says `asked` when its questions are on their way, then what it saw."""
    names = [f"R{i}" for i in range(plan.servers)]
    left: list[str] = []
    beacons: list[float] = []
    here = threading.Semaphore(0)
    with Session(ROUTER, SWARM, timeout_s=LIMIT_S) as session:

        def ask(name: str, number: int, timeout_s: float) -> Future[Answer[Observation]]:
            request = ObservationRequest(ego="E1", request=number, algorithm="early", capture_ns=0)
            key = keyspace.observation(SWARM, name)
            return session.ask(key, request, Observation, timeout_s=timeout_s)

        link = LinkEstimate(PRIOR_BPS)
        watch = LinkWatch("E1", link)

        def take(state: TcpState) -> None:
            watch.take_tcp(state, time.monotonic())

        session.subscribe(keyspace.net_tcp(SWARM), TcpState, take)
        session.watch_alive(lambda _: here.release(), left.append)
        session.subscribe(
            keyspace.beacon(SWARM, keyspace.ANY),
            Beacon,
            lambda *_: beacons.append(time.monotonic()),
        )
        for _ in names:
            assert here.acquire(timeout=LIMIT_S)
        for name in names:
            while ask(name, 2, 5.0).exception(LIMIT_S):
                time.sleep(0.02)
        links = [session.links()]
        capacities: list[float] = []
        begun = time.monotonic()
        futures = [ask(name, 1, plan.timeout_s) for name in names]
        print("asked", flush=True)
        while not all(future.done() for future in futures):
            links.append(session.links())
            capacities.append(link.capacity(time.monotonic())[0])
            time.sleep(0.05)
        ended = time.monotonic()
        errors = [str(e) for future in futures if (e := future.exception())]
        answers = [f.result().wire_bytes for f in futures if not f.exception()]
        small: list[str | int] = []
        for future in [ask(name, 2, SMALL_TIMEOUT_S) for name in names]:
            failed = future.exception(LIMIT_S)
            small.append(str(failed) if failed else future.result().wire_bytes)
        links.append(session.links())
        seen = Seen(
            errors=errors,
            answers=answers,
            waited_s=ended - begun,
            small=small,
            left=left,
            fewest_links=min(links),
            reopened=session._connection.reopened,
            beacons=sum(begun <= at <= ended for at in beacons),
            capacity_bps=statistics.median(capacities[len(capacities) // 2 :]),
        )
    print(msgspec.json.encode(seen).decode(), flush=True)


def build(ego: subprocess.Popen[str]) -> None:
    """The pair between this namespace and the ego's."""
    run("ip", "link", "set", "lo", "up")
    peer = ("peer", "name", "far", "netns", str(ego.pid))
    run("ip", "link", "add", "near", "type", "veth", *peer)
    run("ip", "addr", "add", f"{NEAR}/24", "dev", "near")
    run("ip", "link", "set", "near", "up")
    inside = ("nsenter", f"--net=/proc/{ego.pid}/ns/net", "ip")
    run(*inside, "addr", "add", f"{FAR}/24", "dev", "far")
    run(*inside, "link", "set", "far", "up")


def line_of(stream: IO[str] | None) -> str:
    assert stream is not None
    return stream.readline()


def play(plan: Plan) -> Seen:
    """The near end: router, servers and the link's rate."""
    python: dict[str, Any] = {"stdout": subprocess.PIPE, "text": True}
    with ExitStack() as stack:
        # It says when it has its own namespace, then waits until the link is there.
        waiting = 'echo here; read go; exec "$@"'
        ego = stack.enter_context(
            subprocess.Popen(
                [
                    *("unshare", "--net", "sh", "-c", waiting, "sh"),
                    *(*_SELF, "ego", msgspec.json.encode(plan).decode()),
                ],
                stdin=subprocess.PIPE,
                cwd=REPOSITORY,
                **python,
            )
        )
        stack.callback(ego.kill)
        assert line_of(ego.stdout) == "here\n"
        build(ego)
        shape(plan.rate_bps, "add")
        argv = ["--host", NEAR, "--port", str(PORT), "--swarm", SWARM]
        router = stack.enter_context(
            subprocess.Popen([sys.executable, "-m", "swarm.router", *argv])
        )
        stack.callback(router.terminate)
        for i in range(plan.servers):
            serve(f"R{i}", plan, stack)
        assert ego.stdin is not None
        ego.stdin.write("go\n")
        ego.stdin.flush()
        assert line_of(ego.stdout) == "asked\n"
        if plan.later_bps is not None:
            before = fusion_bytes()
            while fusion_bytes() < before + 100_000:
                time.sleep(0.01)
            shape(plan.later_bps)
        seen = msgspec.json.decode(line_of(ego.stdout), type=Seen)
        return msgspec.structs.replace(seen, fusion_bytes=fusion_bytes())


if __name__ == "__main__":
    if sys.argv[1] == "ego":
        ask_all(msgspec.json.decode(sys.argv[2], type=Plan))
    else:
        print(msgspec.json.encode(play(msgspec.json.decode(sys.argv[1], type=Plan))).decode())
