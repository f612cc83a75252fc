"""Redirections on the host's end of a link, by the queueing discipline `clsact` there.

What goes to the robot leaves that end (`egress`), what comes from it arrives there (`ingress`).
Neither way knows of the other; `clsact` goes with the last of them.
"""

from __future__ import annotations

from collections.abc import Mapping

from network_controller.drivers.command import attempt, run, words
from network_controller.drivers.htb import minor
from network_controller.drivers.readings import read_devices
from network_controller.model import Queue
from swarm.errors import NetworkError
from swarm.messages import Direction

_WAYS: Mapping[Direction, str] = {"down": "egress", "up": "ingress"}


def hook(device: str, direction: Direction, to: Queue) -> None:
    """Sends all that passes a device in a direction through a queue first. The slot stands in the
    filter, so that who finds the device finds its queue. Raises NetworkError."""
    if hooks_of(device).get(direction) == to:
        return
    way = _WAYS[direction]
    # Also a redirection to an `ifb` that is no more: it lets nothing through.
    attempt("tc", "filter", "del", "dev", device, way, "pref", "1")
    shown = attempt("tc", "qdisc", "show", "dev", device).stdout
    if "qdisc ingress" in shown:
        attempt("tc", "qdisc", "del", "dev", device, "ingress")
    flow = f"flowid 1:{minor(to.slot, 0)} " if to.slot else ""
    lines = [] if "qdisc clsact" in shown else [f"qdisc add dev {device} clsact"]
    lines.append(
        f"filter add dev {device} {way} protocol all pref 1 u32 match u32 0 0 {flow}"
        f"action mirred egress redirect dev {to.device}"
    )
    run("tc", "-batch", "-", text="\n".join(lines) + "\n")


def unhook(device: str, direction: Direction) -> None:
    """Lets a direction of a device go; no error where nothing is redirected, or the device is
    gone. Raises NetworkError with the kernel's words when the redirection stays."""
    done = attempt("tc", "filter", "del", "dev", device, _WAYS[direction], "pref", "1")
    if done.returncode != 0 and direction in hooks_of(device):
        raise NetworkError(f"tc does not clear {device} {direction}: {words(done)}")
    ways = "".join(f"filter show dev {device} {way}\n" for way in _WAYS.values())
    if not attempt("tc", "-force", "-batch", "-", text=ways).stdout.strip():
        attempt("tc", "qdisc", "del", "dev", device, "clsact")


def hooks_of(device: str) -> Mapping[Direction, Queue]:
    """Where what passes a device is redirected to, by direction."""
    return {way: to for (_, way), to in read_devices([device]).hooks.items()}
