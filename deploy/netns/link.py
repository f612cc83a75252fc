"""The rate of the cell towards the ego: HTB with one class a traffic class, by DSCP."""

from __future__ import annotations

import asyncio
import re
import time

from deploy.netns.network import run
from deploy.spec import SwarmSpec
from swarm.errors import DeployError
from swarm.log import Logger
from swarm.traffic import TrafficClass
from worlds.factory.scenarios import link_rate_bps

FOLLOW_S = 1.0

DSCP_MASK = 0xFC
QUEUE_S = 0.1
"""How much traffic a class may queue at the link's rate: about a Wi-Fi access point's buffer."""
MIN_QUEUE_BYTES = 128 * 1024
_SHARES = {
    TrafficClass.CONTROL: (10, 0.10),
    TrafficClass.FUSION: (20, 0.80),
    TrafficClass.BACKGROUND: (30, 0.10),
}
"""Class number and guaranteed share of the rate; each may borrow all of it, in this order.
Unmarked traffic is background."""


def commands(device: str, rate_bps: int, *, shaped: bool) -> list[str]:
    """The lines for `tc -batch` that shape what leaves through a device.

    Where it is `shaped` already, its classes change and its queues keep what they hold.
    """
    default = _SHARES[TrafficClass.BACKGROUND][0]
    limit = max(MIN_QUEUE_BYTES, int(rate_bps / 8 * QUEUE_S))
    lines = [f"class replace dev {device} parent 1: classid 1:1 htb rate {rate_bps}bit"]
    if not shaped:
        lines.insert(0, f"qdisc replace dev {device} root handle 1: htb default {default}")
    for priority, (traffic, (number, share)) in enumerate(_SHARES.items()):
        lines += [
            f"class replace dev {device} parent 1:1 classid 1:{number} htb "
            f"rate {int(rate_bps * share)}bit ceil {rate_bps}bit prio {priority}",
            f"qdisc replace dev {device} parent 1:{number} handle {number}: bfifo limit {limit}",
        ]
        if not shaped:
            lines.append(
                f"filter replace dev {device} parent 1: protocol ip prio {priority + 1} u32 "
                f"match ip dsfield {traffic.tos:#04x} {DSCP_MASK:#04x} flowid 1:{number}"
            )
    return lines


def shape(device: str, rate_bps: int) -> None:
    """Shapes what leaves through a device, and reads the rate back.

    Raises DeployError when the kernel lacks HTB, bfifo or u32, or keeps another rate.
    """
    try:
        shaped = "qdisc htb 1: root" in run("tc", "qdisc", "show", "dev", device)
        run("tc", "-batch", "-", text="\n".join(commands(device, rate_bps, shaped=shaped)))
    except DeployError as error:
        raise DeployError(
            f"link rate {rate_bps} bit/s cannot be set: {error}; the kernel needs sch_htb, "
            "sch_fifo and cls_u32 (start without --link otherwise)"
        ) from error
    shown = run("tc", "class", "show", "dev", device)
    ceilings = [_bits(text) for text in re.findall(r"ceil (\S+)bit", shown)]
    wrong = [c for c in ceilings if abs(c - rate_bps) > 0.01 * rate_bps]
    if len(ceilings) != len(_SHARES) + 1 or wrong:
        raise DeployError(f"{device} should be shaped to {rate_bps} bit/s, but tc shows: {shown}")


def wanted_bps(spec: SwarmSpec) -> int | None:
    """The rate that the specification fixes, else the one that its scenario asks for now."""
    if spec.link_bps is not None:
        return spec.link_bps
    if spec.world != "factory":
        return None
    wanted = link_rate_bps(spec.scenario, (time.time_ns() - spec.epoch_ns) / 1e9)
    return None if wanted is None else int(wanted)


async def follow(spec: SwarmSpec, device: str, log: Logger) -> None:
    """Keeps a shaped device at the rate that is wanted at each second, until cancelled."""
    current = wanted_bps(spec)
    while current is not None:
        await asyncio.sleep(FOLLOW_S)
        wanted = wanted_bps(spec)
        if wanted is not None and wanted != current:
            try:
                shape(device, wanted)
            except DeployError as error:
                log.error("link_not_shaped", device=device, error=str(error))
                continue
            current = wanted
            log.info("link_shaped", device=device, rate_bps=wanted)


def _bits(text: str) -> float:
    """The number in tc's words: 55M, 5500K, 100000."""
    scale = {"K": 1e3, "M": 1e6, "G": 1e9}.get(text[-1], 1.0)
    return float(text.rstrip("KMG")) * scale
