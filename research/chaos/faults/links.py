"""Links that are cut, in both ways or one, that lose, that are slow or narrow.

Kernels without netem and without a filter that drops still cut a link in one way only: a neighbour
entry with a hardware address that nobody has sends every packet to where nobody takes it.
"""

from __future__ import annotations

import random
import threading

from deploy.netns import network
from research.chaos.faults.base import End, Kind
from research.chaos.history import Fault
from research.chaos.stage import Stage
from swarm import keyspace
from swarm.errors import CoAdaptError
from swarm.messages import ShapeReply, ShapeRequest
from swarm.session import Session
from swarm.traffic import TrafficClass

INSIDE = "eth0"
"""The robot's end of its link."""
NOBODY = "02:00:00:00:00:01"
BURST_S, CLEAR_S = 0.1, 0.4
SLOW = ("rate", "6mbit", "burst", "3000", "latency", "800ms")
"""A queue of 600 kB before a slow link: what goes through it waits."""
NARROW_BPS = 2_000_000
ASK_S = 5.0


def _bridge(stage: Stage, *words: str) -> None:
    stage.inside("ip", *words)


def _robot(stage: Stage, robot: str, *words: str) -> None:
    stage.inside("ip", "-n", robot, *words)


def _unplugged(stage: Stage, fault: Fault) -> End:
    link = network.link_name(stage.spec, fault.target)
    _bridge(stage, "link", "set", link, "down")

    def end() -> str:
        _bridge(stage, "link", "set", link, "up")
        return f"no carrier at {fault.target}"

    return end


def _cut(stage: Stage, fault: Fault) -> End:
    _deafen(stage, fault.target)
    _mute(stage, fault.target)

    def end() -> str:
        _undo_deafen(stage, fault.target)
        _undo_mute(stage, fault.target)
        return f"no packet to or from {fault.target}"

    return end


def _deaf(stage: Stage, fault: Fault) -> End:
    _deafen(stage, fault.target)

    def end() -> str:
        _undo_deafen(stage, fault.target)
        return f"no packet to {fault.target}"

    return end


def _dumb(stage: Stage, fault: Fault) -> End:
    _mute(stage, fault.target)

    def end() -> str:
        _undo_mute(stage, fault.target)
        return f"no packet from {fault.target}"

    return end


def _loss(stage: Stage, fault: Fault) -> End:
    """Bursts of loss in one way or the other, a fifth of the time."""
    chance = random.Random(fault.seed)
    stop = threading.Event()
    bursts = 0

    def work() -> None:
        nonlocal bursts
        while not stop.wait(CLEAR_S * chance.uniform(0.5, 1.5)):
            hit, undo = chance.choice([(_deafen, _undo_deafen), (_mute, _undo_mute)])
            hit(stage, fault.target)
            stop.wait(BURST_S)
            undo(stage, fault.target)
            bursts += 1

    thread = threading.Thread(target=work, name="loss")
    thread.start()

    def end() -> str:
        stop.set()
        thread.join()
        return f"{bursts} bursts of loss at {fault.target}"

    return end


def _slow(stage: Stage, fault: Fault) -> End:
    device = ("dev", INSIDE, "root")
    stage.inside("ip", "netns", "exec", fault.target, "tc", "qdisc", "add", *device, "tbf", *SLOW)

    def end() -> str:
        stage.inside("ip", "netns", "exec", fault.target, "tc", "qdisc", "del", *device)
        return f"6 Mbit/s and a long queue from {fault.target}"

    return end


def _narrow(stage: Stage, fault: Fault) -> End:
    """By the network controller, as `make shape` does it."""
    request = ShapeRequest(
        operator="chaos", profile="rate", rate_bps=NARROW_BPS, duration_s=max(1.0, fault.lasts_s)
    )
    try:
        with Session(stage.state.router, stage.spec.swarm, timeout_s=ASK_S) as session:
            session.ask(
                keyspace.net_shape(stage.spec.swarm),
                request,
                ShapeReply,
                timeout_s=ASK_S,
                traffic=TrafficClass.CONTROL,
            ).result()
    except CoAdaptError as error:
        told = f"not granted: {error}"
        return lambda: told
    return lambda: f"the cell had {NARROW_BPS / 1e6:.0f} Mbit/s"


def _deafen(stage: Stage, robot: str) -> None:
    there = network.address(stage.spec, robot)
    _bridge(stage, *_nobody(there, network.BRIDGE))


def _undo_deafen(stage: Stage, robot: str) -> None:
    there = network.address(stage.spec, robot)
    _bridge(stage, "neigh", "del", there, "dev", network.BRIDGE)


def _mute(stage: Stage, robot: str) -> None:
    _robot(stage, robot, *_nobody(network.BRIDGE_ADDRESS, INSIDE))


def _undo_mute(stage: Stage, robot: str) -> None:
    _robot(stage, robot, "neigh", "del", network.BRIDGE_ADDRESS, "dev", INSIDE)


def _nobody(address: str, device: str) -> tuple[str, ...]:
    return ("neigh", "replace", address, "lladdr", NOBODY, "dev", device, "nud", "permanent")


CUT_S = (1.5, 4.0)
KINDS = (
    Kind("unplug-robot", _unplugged, CUT_S, "target", targets=True, sign="beacon"),
    Kind("partition-robot", _cut, CUT_S, "target", targets=True, sign="beacon"),
    Kind("deaf-robot", _deaf, CUT_S, "target", targets=True, sign="beacon"),
    Kind("mute-robot", _dumb, CUT_S, "target", targets=True, sign="beacon"),
    Kind("lossy-robot", _loss, (3.0, 5.0), "target", targets=True, sign="beacon"),
    Kind("slow-robot", _slow, (3.0, 5.0), "target", targets=True, sign="beacon"),
    Kind("narrow-cell", _narrow, (3.0, 5.0), "everybody", ("cell", "controller")),
)
