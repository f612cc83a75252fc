"""The rate of the cell towards the ego: HTB with one class a traffic class, by DSCP."""

from __future__ import annotations

import re

from deploy.netns.network import run
from swarm.errors import DeployError
from swarm.traffic import TrafficClass

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


def commands(device: str, rate_bps: int) -> list[str]:
    """The lines for `tc -batch` that shape what leaves through a device."""
    default = _SHARES[TrafficClass.BACKGROUND][0]
    limit = max(MIN_QUEUE_BYTES, int(rate_bps / 8 * QUEUE_S))
    lines = [
        f"qdisc replace dev {device} root handle 1: htb default {default}",
        f"class replace dev {device} parent 1: classid 1:1 htb rate {rate_bps}bit",
    ]
    for priority, (traffic, (number, share)) in enumerate(_SHARES.items()):
        lines += [
            f"class replace dev {device} parent 1:1 classid 1:{number} htb "
            f"rate {int(rate_bps * share)}bit ceil {rate_bps}bit prio {priority}",
            f"qdisc replace dev {device} parent 1:{number} handle {number}: bfifo limit {limit}",
            f"filter replace dev {device} parent 1: protocol ip prio {priority + 1} u32 "
            f"match ip dsfield {traffic.tos:#04x} {DSCP_MASK:#04x} flowid 1:{number}",
        ]
    return lines


def shape(device: str, rate_bps: int) -> None:
    """Shapes what leaves through a device, and reads the rate back.

    Raises DeployError when the kernel lacks HTB, bfifo or u32, or keeps another rate.
    """
    try:
        run("tc", "-batch", "-", text="\n".join(commands(device, rate_bps)))
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


def _bits(text: str) -> float:
    """The number in tc's words: 55M, 5500K, 100000."""
    scale = {"K": 1e3, "M": 1e6, "G": 1e9}.get(text[-1], 1.0)
    return float(text.rstrip("KMG")) * scale
