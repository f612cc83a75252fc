"""Processes from outside that join, lie, flood or say nothing (`research.chaos.outsider`).

In a secure swarm every other one has the certificate of a robot, and the rest have none.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, suppress
from subprocess import PIPE
from typing import Any

from deploy.netns import network
from research.chaos.faults.base import Begin, End, Hits, Kind, Sign
from research.chaos.history import LET_IN, Fault
from research.chaos.outsider.place import READY
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
            *("--router", _router(stage, fault)),
            *("--swarm", stage.spec.swarm, "--seed", str(fault.seed)),
            *("--robots", ",".join((ego, *stage.robots)), "--target", fault.target),
        ],
        stdin=PIPE,
        stdout=PIPE,
        text=True,
        env={k: v for k, v in os.environ.items() if k != "LD_PRELOAD"},
    )
    first = process.stdout.readline() if wait and process.stdout is not None else ""

    def end() -> str:
        try:
            rest, _ = process.communicate("", timeout=END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise DeployError(f"the outsider did not end within {END_S:.0f} s") from None
        said = (rest if first.strip() in ("", READY) else first) or "{}"
        return _told(stage, fault, json.loads(said))

    return end


def _router(stage: Stage, fault: Fault) -> str:
    address = f"{network.BRIDGE_ADDRESS}:{stage.spec.router_port}"
    if is_thief(stage, fault):
        return f"tls/{address}#identity={stage.stolen}"
    return f"tcp/{address}"


def is_thief(stage: Stage, fault: Fault) -> bool:
    """Whether it comes with a robot's certificate; chance, by the fault's seed."""
    return stage.stolen is not None and fault.seed % 2 == 0


def _told(stage: Stage, fault: Fault, said: dict[str, Any]) -> str:
    if stage.stolen is None or is_thief(stage, fault):
        if "did" not in said:
            raise DeployError(f"the outsider failed: {said.get('failed', 'it has ended')}")
        by = f"with the certificate of {stage.stolen.name}: " if stage.stolen else ""
        return f"{by}{said['did']}"
    if said.get("sessions"):
        return f"{LET_IN}: {said['sessions']} sessions, {said.get('did')}"
    return f"without a certificate: {said.get('failed') or said.get('did')}"


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
    """Half a request at every HTTP server, many times."""
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
    return Kind(
        name, begin or _attack(name), lasts_s, hits, holds,
        targets=targets, sign=sign, outside=begin is None,
    )  # fmt: skip


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
