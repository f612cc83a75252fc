"""What `tc -s` prints of HTB, as readings.

`tc` has no JSON for HTB's classes before iproute2 6.4, so its text is read. Rates are printed
rounded to at least three digits.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from network_controller.drivers.command import attempt
from network_controller.drivers.htb import NUMBERS, slot_of
from network_controller.model import ClassReading, ClassShape, LinkReading, Queue
from swarm.messages import Direction
from swarm.traffic import TrafficClass

_QDISC = re.compile(r"^qdisc (?P<kind>\S+) (?P<handle>\S+) (?P<rest>.*)$")
_FAILED = re.compile(r"Command failed \S*:(\d+)")
_CLASS = re.compile(
    r"^class htb 1:(?P<number>[0-9a-f]+) (?P<place>root|parent 1:[0-9a-f]+)"
    r"(?: leaf \S+)?(?: prio (?P<prio>\d+))?(?: quantum \S+)? rate (?P<rate>\S+)bit"
    r"(?: overhead \S+)? ceil (?P<ceil>\S+)bit"
)
_LEAF = re.compile(r"^parent 1:(?P<number>[0-9a-f]+)")
_SENT = re.compile(r"Sent (?P<sent>\d+) bytes .*dropped (?P<drops>\d+), overlimits (?P<over>\d+)")
_BACKLOG = re.compile(r"backlog (?P<backlog>\S+)b ")
_DELAY = re.compile(r"delay (?P<number>[\d.]+)(?P<unit>us|ms|s)")
_LOSS = re.compile(r"loss (?P<percent>[\d.]+)%")
_FILTER = re.compile(
    r"flowid 1:(?P<name>[0-9a-f]+).*\n(?P<matches>(?:\s*match [0-9a-f/]+ at \d+ *\n?)+)"
)
_MATCH = re.compile(r"match ([0-9a-f/]+ at \d+)")
_FLOWID = re.compile(r"flowid 1:(?P<name>[0-9a-f]+)")
_REDIRECT = re.compile(r"mirred \(Egress Redirect to device (?P<device>\S+?)\)")
_SHOW = (
    "qdisc show dev {}",
    "class show dev {}",
    "filter show dev {} egress",
    "filter show dev {} ingress",
)
_BY_NUMBER = {str(number): traffic for traffic, number in NUMBERS.items()}


@dataclass(frozen=True, slots=True)
class Seen:
    """What `tc` shows of devices."""

    readings: Mapping[Queue, LinkReading]
    hooks: Mapping[tuple[str, Direction], Queue]
    """Where what goes to a robot through a device, or comes from it, is redirected to."""
    text: str


def read_devices(devices: Collection[str], more: str = "") -> Seen:
    """Reads all queues on devices, the devices' redirections, and what else `tc` prints for the
    lines of `more`, all by one process.

    Raises NetworkError when `tc` cannot be run.
    """
    if not devices:
        return Seen({}, {}, "")
    names = list(devices)
    batch = "".join(f"{line.format(name)}\n" for name in names for line in _SHOW)
    # With -force a device that has just vanished costs only its own lines.
    done = attempt("tc", "-s", "-force", "-batch", "-", text=batch + more)
    failed = {int(number) for number in _FAILED.findall(done.stderr)}
    # Its queues are asked for first.
    here = [name for i, name in enumerate(names) if len(_SHOW) * i + 1 not in failed]
    gathered = _gather(done.stdout, here)
    hooks = {(name, way): to for name, one in gathered for way, to in one.hooks.items()}
    return Seen(_readings(gathered), hooks, done.stdout)


def parse(text: str, devices: Sequence[str]) -> Mapping[Queue, LinkReading]:
    """Readings in the output of `qdisc show` and `class show` for each device in turn."""
    return _readings(_gather(text, devices))


def filters(text: str) -> frozenset[tuple[str, tuple[str, ...]]]:
    """The filters in the output of `filter show`; see `htb.filters`."""
    return frozenset(
        (found["name"], tuple(_MATCH.findall(found["matches"]))) for found in _FILTER.finditer(text)
    )


def _readings(gathered: Sequence[tuple[str, _Device]]) -> Mapping[Queue, LinkReading]:
    return {
        reading.queue: reading for name, device in gathered for reading in device.readings(name)
    }


def _gather(text: str, devices: Sequence[str]) -> Sequence[tuple[str, _Device]]:
    """What is told of each device. Nothing names it, but each has one root queue, which comes
    first."""
    gathered: list[_Device] = []
    for line in text.splitlines():
        if match := _QDISC.match(line):
            if match["rest"].startswith("root"):
                gathered.append(_Device())
            if gathered:
                gathered[-1].queue(match["kind"], match["rest"])
        elif gathered:
            gathered[-1].line(line.strip())
    return list(zip(devices, gathered, strict=False))


class _Device:
    """Gathers the lines about one device."""

    def __init__(self) -> None:
        self.hooks: dict[Direction, Queue] = {}
        self._hook_slot = 0
        self._root_bps = 0
        self._guarantees: dict[int, int] = {}
        """Of the links that share the root, by slot, bit/s."""
        self._shapes: dict[str, ClassShape] = {}
        self._counts: dict[str, list[int]] = {}
        self._now = ""
        self._leaf = ""
        self._leaf_drops: dict[str, int] = {}
        self._delays_ms: dict[int, float] = {}
        self._losses: dict[int, float] = {}

    def queue(self, kind: str, rest: str) -> None:
        leaf = _LEAF.search(rest)
        self._now, self._leaf = "", leaf["number"] if leaf else ""
        if kind != "netem":
            return
        slot, _ = slot_of(self._leaf)
        if delay := _DELAY.search(rest):
            scale = {"us": 1e-3, "ms": 1.0, "s": 1e3}[delay["unit"]]
            self._delays_ms[slot] = float(delay["number"]) * scale
        if loss := _LOSS.search(rest):
            self._losses[slot] = float(loss["percent"]) / 100.0

    def line(self, line: str) -> None:
        if line.startswith("class "):
            self._leaf = ""
            match = _CLASS.match(line)
            self._now = match["number"] if match else ""
            slot, number = slot_of(self._now) if match else (0, "")
            if match and match["place"] == "root":
                self._root_bps = rate_bps(match["ceil"])
            elif match and number == "00":
                self._guarantees[slot] = rate_bps(match["rate"])
            elif match:
                self._shapes[self._now] = ClassShape(
                    rate_bps(match["rate"]), rate_bps(match["ceil"]), int(match["prio"] or 0)
                )
        elif line.startswith("filter "):
            self._now = self._leaf = ""
            flow = _FLOWID.search(line)
            self._hook_slot = slot_of(flow["name"])[0] if flow else 0
        elif to := _REDIRECT.search(line):
            # Only what is redirected to a slot has one: that is on its way to a robot.
            self.hooks["down" if self._hook_slot else "up"] = Queue(to["device"], self._hook_slot)
        elif self._leaf and (sent := _SENT.search(line)):
            self._leaf_drops[self._leaf] = int(sent["drops"])
        elif self._now and (sent := _SENT.search(line)):
            self._counts[self._now] = [int(sent["sent"]), 0, int(sent["drops"]), int(sent["over"])]
        elif self._now in self._counts and (waiting := _BACKLOG.match(line)):
            self._counts[self._now][1] = size_bytes(waiting["backlog"])

    def readings(self, name: str) -> Iterator[LinkReading]:
        """Of the device's own link, or of those that share its tree."""
        by_slot: dict[int, dict[TrafficClass, ClassReading]] = {}
        for number, shape in self._shapes.items():
            slot, leaf = slot_of(number)
            if leaf in _BY_NUMBER:
                by_slot.setdefault(slot, {})[_BY_NUMBER[leaf]] = self._class(number, shape)
        for slot, classes in by_slot.items():
            capacity_bps = self._guarantees.get(slot, 0) if slot else self._root_bps
            if capacity_bps and self._root_bps:
                yield LinkReading(
                    capacity_bps,
                    classes,
                    self._delays_ms.get(slot, 0.0),
                    self._losses.get(slot, 0.0),
                    self._root_bps if slot else 0,
                    Queue(name, slot),
                )

    def _class(self, number: str, shape: ClassShape) -> ClassReading:
        sent, backlog, drops, overlimits = self._counts.get(number, (0, 0, 0, 0))
        # What a queue drops while it holds packets, as fq_codel does, its class does not count.
        drops = max(drops, self._leaf_drops.get(number, 0))
        return ClassReading(shape, sent, backlog, drops, overlimits)


def rate_bps(text: str) -> int:
    """Bit/s in tc's words without `bit`: 55M, 5500K, 100000."""
    scale = {"K": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}.get(text[-1], 1.0)
    return round(float(text.rstrip("KMGT")) * scale)


def size_bytes(text: str) -> int:
    """Bytes in tc's words without `b`: 1514, 120K, 3M (of 1,024)."""
    scale = {"K": 1024, "M": 1024**2, "G": 1024**3}.get(text[-1], 1)
    return round(float(text.rstrip("KMG")) * scale)
