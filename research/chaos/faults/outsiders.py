"""Processes from outside that join, lie, flood or say nothing (`research.chaos.outsider`)."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, suppress

from deploy.netns import network
from research.chaos.faults.base import Begin, End, Hits, Kind, Sign
from research.chaos.history import Fault
from research.chaos.stage import Stage
from swarm.errors import DeployError

END_S = 15.0
CONNECTIONS = 40


def start(stage: Stage, fault: Fault, attack: str, *, wait: bool = False) -> End:
    """Has an outsider attack from the swarm's network; what ends it tells what it says. With `wait`
    the attack is under way on return."""
    ego = stage.spec.ego
    process = subprocess.Popen(
        [
            *("nsenter", f"--target={stage.supervisor}", "--net"),
            *(sys.executable, "-m", "research.chaos.outsider", attack),
            *("--router", f"tcp/{network.BRIDGE_ADDRESS}:{stage.spec.router_port}"),
            *("--swarm", stage.spec.swarm, "--seed", str(fault.seed)),
            *("--robots", ",".join((ego, *stage.robots)), "--target", fault.target),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={k: v for k, v in os.environ.items() if k != "LD_PRELOAD"},
    )

    if wait and process.stdout is not None:
        process.stdout.readline()

    def end() -> str:
        try:
            said, _ = process.communicate("", timeout=END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise DeployError(f"the outsider did not end within {END_S:.0f} s") from None
        words: dict[str, str] = json.loads(said or "{}")
        if "did" not in words:
            raise DeployError(f"the outsider failed: {words.get('failed', 'it has ended')}")
        return words["did"]

    return end


def _attack(name: str) -> Begin:
    return lambda stage, fault: start(stage, fault, name)


def _before(name: str) -> Begin:
    """The robot is killed when the outsider is there: questions go to who was there first."""

    def begin(stage: Stage, fault: Fault) -> End:
        end = start(stage, fault, name, wait=True)
        stage.signal(f"robot-{fault.target}", signal.SIGKILL)
        return end

    return begin


def _doors(stage: Stage, fault: Fault) -> End:
    """Half a request at every HTTP door, many times."""
    spec = stage.spec
    stack = ExitStack()
    held = refused = 0
    for port in (spec.qod_port, spec.console_port, spec.llm_port, spec.ego_metrics_port):
        for _ in range(CONNECTIONS):
            try:
                one = stack.enter_context(socket.create_connection(("127.0.0.1", port), 1.0))
                one.sendall(b"GET / HTTP/1.1\r\nHost: ")
                held += 1
            except OSError:
                refused += 1

    def end() -> str:
        with suppress(OSError):
            stack.close()
        return f"{held} half requests held, {refused} connections refused"

    return end


def _kind(
    name: str,
    lasts_s: tuple[float, float],
    hits: Hits = "nobody",
    *,
    begin: Begin | None = None,
    sign: Sign = "none",
) -> Kind:
    targets = name not in UNTARGETED
    holds = (name,) if not targets else ()
    return Kind(name, begin or _attack(name), lasts_s, hits, holds, targets=targets, sign=sign)


UNTARGETED = (
    "join-leave", "fake-tokens", "garbage", "wildcard-puts", "silent-connections", "half-requests",
)  # fmt: skip
BRIEF, LONG = (3.0, 5.0), (6.0, 8.0)
KINDS = (
    _kind("join-leave", LONG),
    _kind("fake-tokens", BRIEF),
    _kind("fake-beacon", BRIEF, "target"),
    _kind("numbers-ahead", BRIEF, "target"),
    _kind("impostor", LONG, "target", begin=_before("impostor"), sign="process"),
    _kind("withdrawn-server", LONG, "target", begin=_before("withdrawn-server"), sign="process"),
    _kind("huge-message", BRIEF),
    _kind("waiting-queries", BRIEF, "target"),
    _kind("garbage", BRIEF),
    _kind("wildcard-puts", BRIEF),
    _kind("silent-connections", BRIEF),
    _kind("half-requests", BRIEF, begin=_doors),
)
