"""What `tc -s` prints of HTB, as readings.

`tc` has no JSON for HTB's classes before iproute2 6.4, so its text is read. Rates are printed
rounded to at least three digits.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from network_controller.drivers.command import attempt
from network_controller.drivers.htb import NUMBERS
from network_controller.model import ClassReading, ClassShape, LinkReading

_QDISC = re.compile(r"^qdisc (?P<kind>\S+) (?P<handle>\S+) (?P<rest>.*)$")
_FAILED = re.compile(r"Command failed \S*:(\d+)")
_CLASS = re.compile(
    r"^class htb 1:(?P<number>[0-9a-f]+) (?P<place>root|parent 1:1)"
    r"(?: leaf \S+)?(?: prio (?P<prio>\d+))?(?: quantum \S+)? rate (?P<rate>\S+)bit"
    r"(?: overhead \S+)? ceil (?P<ceil>\S+)bit"
)
_LEAF = re.compile(r"^parent 1:(?P<number>[0-9a-f]+)")
_SENT = re.compile(r"Sent (?P<sent>\d+) bytes .*dropped (?P<drops>\d+), overlimits (?P<over>\d+)")
_BACKLOG = re.compile(r"backlog (?P<backlog>\S+)b ")
_DELAY = re.compile(r"delay (?P<number>[\d.]+)(?P<unit>us|ms|s)")
_LOSS = re.compile(r"loss (?P<percent>[\d.]+)%")
_FILTER = re.compile(r"flowid 1:(?P<number>[0-9a-f]+).*\n\s*match (?P<match>[0-9a-f/]+) at 0")
_BY_NUMBER = {str(number): traffic for traffic, number in NUMBERS.items()}


def read_devices(devices: Collection[str], more: str = "") -> tuple[Mapping[str, LinkReading], str]:
    """Readings of all devices that carry our shape, and what else `tc` prints for the lines of
    `more`, all by one process.

    Raises NetworkError when `tc` cannot be run.
    """
    if not devices:
        return {}, ""
    names = list(devices)
    batch = "".join(f"qdisc show dev {name}\nclass show dev {name}\n" for name in names)
    # With -force a device that has just vanished costs only its own lines.
    done = attempt("tc", "-s", "-force", "-batch", "-", text=batch + more)
    failed = {int(number) for number in _FAILED.findall(done.stderr)}
    # Its queues are asked for on line 1, 3, 5 ... of the batch.
    found = parse(done.stdout, [n for i, n in enumerate(names) if 2 * i + 1 not in failed])
    return found, done.stdout


def parse(text: str, devices: Sequence[str]) -> Mapping[str, LinkReading]:
    """Readings by device in the output of `qdisc show` and `class show` for each device in turn.

    Nothing in it names a device, but each has one root queue, and that comes first.
    """
    gathered: list[_Device] = []
    for line in text.splitlines():
        if match := _QDISC.match(line):
            if match["rest"].startswith("root"):
                gathered.append(_Device())
            if gathered:
                gathered[-1].queue(match["kind"], match["rest"])
        elif gathered:
            gathered[-1].line(line.strip())
    found = {name: one.reading() for name, one in zip(devices, gathered, strict=False)}
    return {name: reading for name, reading in found.items() if reading is not None}


def filters(text: str) -> frozenset[tuple[int, str]]:
    """The filters in the output of `filter show`; see `htb.filters`."""
    return frozenset((int(f["number"]), f["match"]) for f in _FILTER.finditer(text))


class _Device:
    """Gathers the lines about one device."""

    def __init__(self) -> None:
        self._capacity_bps = 0
        self._shapes: dict[str, ClassShape] = {}
        self._counts: dict[str, list[int]] = {}
        self._now = ""
        self._leaf = ""
        self._leaf_drops: dict[str, int] = {}
        self._delay_ms = 0.0
        self._loss = 0.0

    def queue(self, kind: str, rest: str) -> None:
        leaf = _LEAF.search(rest)
        self._now, self._leaf = "", leaf["number"] if leaf else ""
        if kind != "netem":
            return
        if delay := _DELAY.search(rest):
            scale = {"us": 1e-3, "ms": 1.0, "s": 1e3}[delay["unit"]]
            self._delay_ms = float(delay["number"]) * scale
        if loss := _LOSS.search(rest):
            self._loss = float(loss["percent"]) / 100.0

    def line(self, line: str) -> None:
        if line.startswith("class "):
            self._leaf = ""
            match = _CLASS.match(line)
            self._now = match["number"] if match else ""
            if match and match["place"] == "root":
                self._capacity_bps = rate_bps(match["ceil"])
            elif match:
                self._shapes[self._now] = ClassShape(
                    rate_bps(match["rate"]), rate_bps(match["ceil"]), int(match["prio"] or 0)
                )
        elif line.startswith("filter "):
            self._now = self._leaf = ""
        elif self._leaf and (sent := _SENT.search(line)):
            self._leaf_drops[self._leaf] = int(sent["drops"])
        elif self._now and (sent := _SENT.search(line)):
            self._counts[self._now] = [int(sent["sent"]), 0, int(sent["drops"]), int(sent["over"])]
        elif self._now in self._counts and (waiting := _BACKLOG.match(line)):
            self._counts[self._now][1] = size_bytes(waiting["backlog"])

    def reading(self) -> LinkReading | None:
        classes = {
            _BY_NUMBER[number]: self._class(number, shape)
            for number, shape in self._shapes.items()
            if number in _BY_NUMBER
        }
        if not self._capacity_bps or not classes:
            return None
        return LinkReading(self._capacity_bps, classes, self._delay_ms, self._loss)

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
