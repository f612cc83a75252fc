"""Shapes devices with `tc`: verified, rolled back when it fails, in both directions.

What goes to a robot leaves through the host's end of its link: HTB there. What comes from it
arrives there, and cannot be queued on arrival: it is redirected to an `ifb` device of its own,
which has the HTB. So nothing enters a robot's namespace.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping

from network_controller.drivers import htb
from network_controller.drivers.command import attempt, run, words
from network_controller.drivers.interfaces import facts_of, index_of
from network_controller.drivers.probe import probe
from network_controller.drivers.readings import filters, parse, read_devices
from network_controller.model import (
    NEEDED,
    NEEDED_UP,
    Capabilities,
    ClassShape,
    LinkReading,
    LinkShape,
)
from swarm.errors import LinkGoneError, NetworkError
from swarm.messages import Direction

IFB_PREFIX = "ifb-"
IFB_MARK = "coadapt "
"""How the alias of our `ifb` devices begins, before the device that they queue for."""
MAX_NAME = 15
"""Of an interface, in bytes."""
_TOLERANCE = 0.01
"""`tc` prints rates rounded."""
_REDIRECT = re.compile(r"Redirect to device (\S+?)\)")


class Shaper:
    """Shapes devices of this network namespace. Who calls it has made sure that they are ours."""

    def __init__(self, swarm: str) -> None:
        """The swarm's name keeps what is tried here apart from other swarms on this host."""
        self._swarm = swarm
        self._capabilities: Capabilities | None = None

    def capabilities(self) -> Capabilities:
        """What the kernel can do, tried once. Raises NetworkError when nothing can be tried."""
        if self._capabilities is None:
            self._capabilities = probe(self._swarm)
        return self._capabilities

    def apply(self, device: str, direction: Direction, shape: LinkShape) -> None:
        """Shapes one direction and reads it back; when that fails, all is as before.

        Raises NetworkError with the kernel's words, LinkGoneError when the device vanished.
        """
        self._check(direction, shape)
        try:
            if direction == "down":
                self._shape(device, shape)
            else:
                self._shape_up(device, ifb_of(device), shape)
        except NetworkError as error:
            if not index_of(device):
                raise LinkGoneError(f"interface {device} has vanished: {error}") from error
            raise

    def _check(self, direction: Direction, shape: LinkShape) -> None:
        missing = self.capabilities().missing
        needed = NEEDED if direction == "down" else (*NEEDED, *NEEDED_UP)
        wants = [f for f in needed if f in missing]
        if shape.delay_ms or shape.loss:
            wants += ["netem"] if "netem" in missing else []
        if wants:
            reasons = "; ".join(f"{feature}: {missing[feature]}" for feature in wants)
            what = "delay and loss need" if wants == ["netem"] else f"shaping {direction} needs"
            raise NetworkError(f"{what} {', '.join(wants)}, which this kernel lacks ({reasons})")

    def _shape_up(self, device: str, ifb: str, shape: LinkShape) -> None:
        before = read([(device, "up")])
        try:
            _make_ifb(ifb, device)
            self._shape(ifb, shape)
            _redirect(device, ifb)
        except NetworkError:
            if not before:
                clear(device, "up")
            raise

    def _shape(self, device: str, shape: LinkShape) -> None:
        show = f"qdisc show dev {device}\nclass show dev {device}\n"
        before = _reading(device, attempt("tc", "-batch", "-", text=show + _filters(device)).stdout)
        if before is None:
            # Half of a shape that somebody left, or the queue that the system gave it.
            attempt("tc", "qdisc", "del", "dev", device, "root")
        try:
            self._write(device, shape, shaped=before is not None)
        except NetworkError as error:
            if before is None:
                attempt("tc", "qdisc", "del", "dev", device, "root")
                raise
            try:
                self._write(device, _shape_of(before), shaped=True)
            except NetworkError as again:
                raise NetworkError(
                    f"{error}; nor can its last shape be restored: {again}"
                ) from error
            raise

    def _write(self, device: str, shape: LinkShape, *, shaped: bool) -> None:
        """Changes a device and reads it back, by one process."""
        fq_codel = "fq_codel" in self.capabilities().present
        changes = "\n".join(htb.lines(device, shape, shaped=shaped, fq_codel=fq_codel))
        show = f"\nqdisc show dev {device}\nclass show dev {device}\n"
        text = changes + show + _filters(device)
        done = attempt("tc", "-batch", "-", text=text)
        if done.returncode != 0:
            raise NetworkError(f"tc refuses to shape {device}: {words(done, text)}")
        reading = _reading(device, done.stdout)
        if reading is None:
            raise NetworkError(f"{device} should be shaped, but `tc` shows no whole shape")
        wrong = list(_differences(reading, shape))
        if wrong:
            raise NetworkError(f"{device} has another shape than it should: {'; '.join(wrong)}")


def ifb_of(device: str) -> str:
    """The name of the device that queues what comes through a device."""
    name = IFB_PREFIX + device
    if len(name) <= MAX_NAME:
        return name
    return IFB_PREFIX + hashlib.blake2s(device.encode(), digest_size=5).hexdigest()


def queueing_device(device: str, direction: Direction) -> str:
    """The name of the device whose HTB queues a direction of what goes through a device."""
    return device if direction == "down" else ifb_of(device)


def clear(device: str, direction: Direction) -> None:
    """Makes one direction unshaped; no error when it is so already, or the device is gone.

    Raises NetworkError with the kernel's words when the shape stays.
    """
    place = "root" if direction == "down" else "ingress"
    done = attempt("tc", "qdisc", "del", "dev", device, place)
    if done.returncode != 0 and place in _ours_on(device):
        raise NetworkError(f"tc does not clear {device} {direction}: {words(done)}")
    ifb = ifb_of(device)
    # Only now: what a redirection sends to an `ifb` that is no more is lost.
    if direction == "up" and index_of(ifb) and _is_ours(facts_of(ifb)):
        done = attempt("ip", "link", "del", ifb)
        if done.returncode != 0 and index_of(ifb):
            raise NetworkError(f"ip does not remove {ifb}: {words(done)}")


def forget(devices: Iterable[str]) -> None:
    """Removes what outlives those of these devices that have vanished."""
    for device in devices:
        if not index_of(device):
            clear(device, "up")


def read(devices: Collection[tuple[str, Direction]]) -> Mapping[tuple[str, Direction], LinkReading]:
    """Readings of directions of devices; those that are not shaped are left out."""
    names = {(d, way): queueing_device(d, way) for d, way in devices}
    redirections = "".join(_show_redirection(d) for d, way in devices if way == "up")
    found, text = read_devices(sorted(set(names.values())), redirections)
    fed = _REDIRECT.findall(text)
    return {
        place: found[name]
        for place, name in names.items()
        if name in found and (place[1] == "down" or name in fed)
    }


def orphans(devices: Collection[str]) -> tuple[str, ...]:
    """Our `ifb` devices that belong to none of these devices: their links are gone."""
    shown = json.loads(run("ip", "-j", "link", "show", "type", "ifb") or "[]")
    names = {one["ifname"] for one in shown if _is_ours(one)}
    return tuple(sorted(names - {ifb_of(device) for device in devices}))


def _is_ours(facts: Mapping[str, object]) -> bool:
    return str(facts.get("ifalias", "")).startswith(IFB_MARK)


def _ours_on(device: str) -> str:
    """Which of our queues a device has, in tc's words: of `root` and `ingress`."""
    shown = attempt("tc", "qdisc", "show", "dev", device).stdout
    return " ".join(
        place
        for place, queue in (("root", "qdisc htb 1: root"), ("ingress", "qdisc ingress"))
        if queue in shown
    )


def _make_ifb(ifb: str, device: str) -> None:
    if not index_of(ifb):
        # By one process, so that none is left behind that nobody knows whose it is.
        lines = f"link add {ifb} type ifb\nlink set {ifb} alias '{IFB_MARK}{device}' up\n"
        try:
            run("ip", "-batch", "-", text=lines)
        except NetworkError:
            attempt("ip", "link", "del", ifb)
            raise
    elif not _is_ours(facts_of(ifb)):
        raise NetworkError(
            f"interface {ifb}, which should queue what comes through {device}, is not the swarm's: "
            f"its alias does not begin with {IFB_MARK.strip()!r}; rename or remove it"
        )


def _redirect(device: str, ifb: str) -> None:
    """Sends all that comes through a device through its `ifb` first."""
    if ifb in _REDIRECT.findall(
        attempt("tc", "-batch", "-", text=_show_redirection(device)).stdout
    ):
        return
    # Also a redirection to an `ifb` that is no more: it lets nothing through.
    attempt("tc", "qdisc", "del", "dev", device, "ingress")
    lines = (
        f"qdisc add dev {device} handle ffff: ingress\n"
        f"filter add dev {device} parent ffff: protocol all prio 1 u32 match u32 0 0 "
        f"action mirred egress redirect dev {ifb}\n"
    )
    run("tc", "-batch", "-", text=lines)


def _show_redirection(device: str) -> str:
    return f"filter show dev {device} parent ffff:\n"


def _filters(device: str) -> str:
    return f"filter show dev {device} parent 1:\n"


def _reading(device: str, text: str) -> LinkReading | None:
    """A device's shape in what `tc` shows of it; None unless it is whole, filters and all."""
    reading = parse(text, [device]).get(device)
    if (
        reading is None
        or set(reading.classes) != set(htb.NUMBERS)
        or filters(text) != htb.filters()
    ):
        return None
    return reading


def _differences(have: LinkReading, wanted: LinkShape) -> Iterator[str]:
    """What a reading has otherwise than a shape."""
    pairs = [
        ("the capacity in bit/s", have.capacity_bps, wanted.capacity_bps),
        ("the delay in ms", have.delay_ms, wanted.delay_ms),
        ("the loss in %", 100 * have.loss, 100 * wanted.loss),
    ]
    for traffic, should in wanted.classes.items():
        has, name = have.classes[traffic].shape, traffic.name.lower()
        pairs += [
            (f"{name}'s rate in bit/s", has.rate_bps, should.rate_bps),
            (f"{name}'s ceiling in bit/s", has.ceil_bps, should.ceil_bps),
        ]
        if has.priority != should.priority:
            yield f"{name}'s priority is {has.priority}, not {should.priority}"
    for what, is_now, should_be in pairs:
        slack = 8.0 if what.endswith("bit/s") else 0.01
        if abs(is_now - should_be) > max(slack, _TOLERANCE * should_be):
            yield f"{what} is {is_now:g}, not {should_be:g}"


def _shape_of(reading: LinkReading) -> LinkShape:
    classes = {
        traffic: ClassShape(one.shape.rate_bps, one.shape.ceil_bps, one.shape.priority)
        for traffic, one in reading.classes.items()
    }
    return LinkShape(reading.capacity_bps, classes, reading.delay_ms, reading.loss)
