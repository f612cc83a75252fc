"""Shaping devices with HTB: verified, rolled back when it fails, in both directions.

What goes to a robot leaves through the host's end of its link: HTB there. What comes from it
arrives there, and cannot be queued on arrival: it is redirected to an `ifb` device of its own,
which has the HTB. So nothing enters a robot's namespace.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from contextlib import suppress

from network_controller.drivers import htb
from network_controller.drivers.command import attempt, run, words
from network_controller.drivers.readings import read_devices
from network_controller.model import (
    FEATURES,
    NEEDED,
    Capabilities,
    ClassShape,
    LinkReading,
    LinkShape,
)
from swarm.errors import LinkGoneError, NetworkError
from swarm.messages import Direction

IFB_PREFIX = "ifb-"
MAX_NAME = 15
"""Of an interface, in bytes."""
_PROBE, _PEER, _PROBE_IFB = "coadapt-probe", "coadapt-peer", "ifb-probe"
_TOLERANCE = 0.01
"""`tc` prints rates rounded."""


class Shaper:
    """Shapes devices of this network namespace. Who calls it has made sure that they are ours."""

    def __init__(self) -> None:
        self._capabilities: Capabilities | None = None

    def capabilities(self) -> Capabilities:
        """What the kernel can do, tried once. Raises NetworkError when nothing can be tried."""
        if self._capabilities is None:
            self._capabilities = probe()
        return self._capabilities

    def apply(self, device: str, direction: Direction, shape: LinkShape) -> None:
        """Shapes one direction and reads it back; when that fails, all is as before.

        Raises NetworkError with the kernel's words, LinkGoneError when the device vanished.
        """
        self._check(direction, shape)
        target = device if direction == "down" else ifb_of(device)
        try:
            if direction == "up":
                _redirect(device, target)
            self._shape(target, shape)
        except NetworkError as error:
            if direction == "up" and not read_devices([target]):
                clear(device, "up")
            if not exists(device):
                raise LinkGoneError(f"interface {device} has vanished: {error}") from error
            raise

    def _check(self, direction: Direction, shape: LinkShape) -> None:
        missing = self.capabilities().missing
        needed = NEEDED if direction == "down" else (*NEEDED, "ingress", "mirred", "ifb")
        wants = [f for f in needed if f in missing]
        if shape.delay_ms or shape.loss:
            wants += ["netem"] if "netem" in missing else []
        if wants:
            reasons = "; ".join(f"{feature}: {missing[feature]}" for feature in wants)
            what = "delay and loss need" if wants == ["netem"] else f"shaping {direction} needs"
            raise NetworkError(f"{what} {', '.join(wants)}, which this kernel lacks ({reasons})")

    def _shape(self, device: str, shape: LinkShape) -> None:
        before = read_devices([device]).get(device)
        fq_codel = "fq_codel" in self.capabilities().present
        try:
            if before is None:
                # Half of a shape that somebody left, or the queue that the system gave it.
                attempt("tc", "qdisc", "del", "dev", device, "root")
            batch = htb.lines(device, shape, shaped=before is not None, fq_codel=fq_codel)
            run("tc", "-batch", "-", text="\n".join(batch) + "\n")
            _verify(device, shape)
        except NetworkError:
            if before is None:
                attempt("tc", "qdisc", "del", "dev", device, "root")
            else:
                again = htb.lines(device, _shape_of(before), shaped=True, fq_codel=fq_codel)
                attempt("tc", "-force", "-batch", "-", text="\n".join(again) + "\n")
            raise


def ifb_of(device: str) -> str:
    """The name of the device that queues what comes through a device."""
    return (IFB_PREFIX + device)[:MAX_NAME]


def clear(device: str, direction: Direction) -> None:
    """Makes one direction unshaped; no error when it is so already, or the device is gone."""
    if direction == "down":
        attempt("tc", "qdisc", "del", "dev", device, "root")
    else:
        attempt("tc", "qdisc", "del", "dev", device, "ingress")
        attempt("ip", "link", "del", ifb_of(device))


def read(devices: Collection[tuple[str, Direction]]) -> Mapping[tuple[str, Direction], LinkReading]:
    """Readings of directions of devices; those that are not shaped are left out."""
    names = {(d, way): d if way == "down" else ifb_of(d) for d, way in devices}
    found = read_devices(sorted(set(names.values())))
    return {place: found[name] for place, name in names.items() if name in found}


def exists(device: str) -> bool:
    """Whether there is such an interface."""
    return attempt("ip", "link", "show", "dev", device).returncode == 0


def orphans(devices: Collection[str]) -> tuple[str, ...]:
    """Our `ifb` devices that belong to none of these devices: their links are gone."""
    shown = json.loads(run("ip", "-j", "link", "show", "type", "ifb") or "[]")
    names = {one["ifname"] for one in shown if one.get("ifname", "").startswith(IFB_PREFIX)}
    names.discard(_PROBE_IFB)
    return tuple(sorted(names - {ifb_of(device) for device in devices}))


def _redirect(device: str, ifb: str) -> None:
    """Sends all that comes through a device through its `ifb` first."""
    if not exists(ifb):
        run("ip", "link", "add", ifb, "type", "ifb")
    run("ip", "link", "set", ifb, "up")
    if "ingress" not in run("tc", "qdisc", "show", "dev", device, "ingress"):
        run("tc", "qdisc", "add", "dev", device, "handle", "ffff:", "ingress")
    if "mirred" not in run("tc", "filter", "show", "dev", device, "parent", "ffff:"):
        run(
            *("tc", "filter", "add", "dev", device, "parent", "ffff:", "protocol", "all"),
            *("prio", "1", "u32", "match", "u32", "0", "0"),
            *("action", "mirred", "egress", "redirect", "dev", ifb),
        )


def _verify(device: str, shape: LinkShape) -> None:
    """Raises NetworkError when the kernel has another shape than it should."""
    have = read_devices([device]).get(device)
    if have is None:
        raise NetworkError(f"{device} should be shaped, but `tc` shows no shape")
    pairs = [("capacity", have.capacity_bps, shape.capacity_bps)]
    for traffic, wanted in shape.classes.items():
        one = have.classes.get(traffic)
        name = traffic.name.lower()
        if one is None:
            raise NetworkError(f"{device} has no class for {name} after it was shaped")
        pairs += [
            (f"{name}'s rate", one.shape.rate_bps, wanted.rate_bps),
            (f"{name}'s ceiling", one.shape.ceil_bps, wanted.ceil_bps),
        ]
        if one.shape.priority != wanted.priority:
            raise NetworkError(
                f"{device}: {name} should have priority {wanted.priority}, but has "
                f"{one.shape.priority}"
            )
    for what, has, should in pairs:
        if abs(has - should) > max(8, _TOLERANCE * should):
            raise NetworkError(f"{device}: {what} should be {should} bit/s, but is {has}")
    filters = run("tc", "filter", "show", "dev", device, "parent", "1:").count("flowid")
    if filters < len(htb.NUMBERS):
        raise NetworkError(f"{device} has {filters} filters after it was shaped")


def _shape_of(reading: LinkReading) -> LinkShape:
    classes = {
        traffic: ClassShape(one.shape.rate_bps, one.shape.ceil_bps, one.shape.priority)
        for traffic, one in reading.classes.items()
    }
    return LinkShape(reading.capacity_bps, classes, reading.delay_ms, reading.loss)


def probe() -> Capabilities:
    """Tries every feature on a pair of devices of its own, and removes them.

    Raises NetworkError when no device can be made: then links cannot be shaped at all.
    """
    attempt("ip", "link", "del", _PROBE)
    made = attempt("ip", "link", "add", _PROBE, "type", "veth", "peer", "name", _PEER)
    if made.returncode != 0:
        raise NetworkError(
            f"links cannot be shaped here: {words(made)}; the controller needs NET_ADMIN in the "
            "network namespace of the links"
        )
    missing: dict[str, str] = {}
    try:
        for feature, argv in _trials():
            done = attempt(*argv)
            if done.returncode != 0:
                missing[feature] = words(done)
    finally:
        for device in (_PROBE, _PROBE_IFB):
            with suppress(NetworkError):
                attempt("ip", "link", "del", device)
    return Capabilities(frozenset(FEATURES) - frozenset(missing), missing)


def _trials() -> list[tuple[str, tuple[str, ...]]]:
    """What to run for each feature, in an order in which each finds what it needs."""
    add = ("tc", "qdisc", "add", "dev", _PROBE)
    root = ("tc", "qdisc", "replace", "dev", _PROBE, "root")
    rule = ("tc", "filter", "add", "dev", _PROBE, "parent")
    everything = ("u32", "match", "u32", "0", "0")
    redirect = ("action", "mirred", "egress", "redirect", "dev", _PEER)
    return [
        ("ifb", ("ip", "link", "add", _PROBE_IFB, "type", "ifb")),
        ("ingress", (*add, "handle", "ffff:", "ingress")),
        ("mirred", (*rule, "ffff:", "protocol", "all", "prio", "1", *everything, *redirect)),
        ("netem", (*root, "netem", "delay", "1ms")),
        ("fq_codel", (*root, "fq_codel")),
        ("bfifo", (*root, "bfifo", "limit", "10000")),
        ("htb", (*root, "handle", "1:", "htb", "default", "1")),
        ("u32", (*rule, "1:", "protocol", "ip", "prio", "1", *everything, "flowid", "1:1")),
    ]
