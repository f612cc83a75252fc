"""Real traffic that links cannot carry, and what they carry of it."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager

from network_controller.model import Link
from swarm.traffic import TrafficClass
from tests.support.link_support import Links, must

FLOOD_BPS = 15_000_000
"""More than any of these links may have."""
WARM_S, COUNTED_S = 0.7, 2.0
LOOKS = 6
FLOOD_S = WARM_S + (LOOKS + 1) * COUNTED_S + 10.0
"""Longer than anybody looks."""
_FLOOD = """
import socket, sys, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
out.setsockopt(0, 1, int(sys.argv[2]))
began, sent, bps, seconds = time.monotonic(), 0, float(sys.argv[3]), float(sys.argv[4])
while (now := time.monotonic() - began) < seconds:
    while 8 * sent < bps * now:
        out.sendto(bytes(1400), (sys.argv[1], 9))
        sent += 1400
    time.sleep(0.002)
"""


def down(net: Links, i: int) -> Link:
    return Link(net.robots[i], "down")


@contextmanager
def floods(
    net: Links, marks: Mapping[int, TrafficClass], seconds: float = FLOOD_S
) -> Iterator[None]:
    """Datagrams to robots, for so long at most; nobody need receive them."""
    with ExitStack() as stack:
        for i, traffic in marks.items():
            argv = [f"10.77.1.{i + 1}", str(traffic.tos), str(FLOOD_BPS), str(seconds)]
            flood = subprocess.Popen([sys.executable, "-c", _FLOOD, *argv])
            stack.callback(flood.wait)
            stack.callback(flood.kill)
        time.sleep(WARM_S)
        yield


def measured(net: Links, of: Collection[int]) -> dict[int, float]:
    """What robots' links carry for a while, bit/s."""
    began_s, before = time.monotonic(), sent_bytes(net, of)
    time.sleep(COUNTED_S)
    after, ended_s = sent_bytes(net, of), time.monotonic()
    return {i: 8 * (after[i] - before[i]) / (ended_s - began_s) for i in of}


def sent_bytes(net: Links, of: Collection[int]) -> dict[int, int]:
    readings = net.driver.read([down(net, i) for i in of])
    return {i: sum(c.sent_bytes for c in readings[down(net, i)].classes.values()) for i in of}


def must_carry(net: Links, wanted_bps: Mapping[int, float]) -> None:
    """Looks at robots' links until they carry what they should, within a tenth: a busy machine
    starves those who send, and wakes the shaper late. None carries more at any time."""
    for _ in range(LOOKS):
        found = measured(net, wanted_bps)
        assert sum(found.values()) < 1.1 * sum(wanted_bps.values()), found
        if all(abs(found[i] - bps) <= 0.1 * bps for i, bps in wanted_bps.items()):
            return
    raise AssertionError(f"carried {found} bit/s, not {dict(wanted_bps)}")


def ifbs() -> list[str]:
    """The `ifb` devices of this namespace."""
    shown = json.loads(must("ip", "-j", "link", "show", "type", "ifb"))
    return [one["ifname"] for one in shown]
