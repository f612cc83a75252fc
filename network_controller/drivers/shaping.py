"""Shapes devices with `tc`: verified, rolled back when it fails, in both directions.

What goes to a robot leaves through the host's end of its link: HTB there. What comes from it
arrives there, and cannot be queued on arrival: it is redirected to an `ifb` device of its own,
which has the HTB. So nothing enters a robot's namespace. Links that share a medium are redirected
to one `ifb` device where they leave, too (`tree.py`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from network_controller.drivers import htb, tree
from network_controller.drivers.command import attempt, words
from network_controller.drivers.compare import differences, shape_of
from network_controller.drivers.hooks import hook, hooks_of, unhook
from network_controller.drivers.ifbs import ifb_of, make_ifb, remove_ifb
from network_controller.drivers.interfaces import index_of
from network_controller.drivers.probe import probe
from network_controller.drivers.readings import filters, parse, read_devices
from network_controller.drivers.tree import Seat
from network_controller.model import (
    NEEDED,
    NEEDED_UP,
    Capabilities,
    LinkReading,
    LinkShape,
    Queue,
)
from swarm.errors import LinkGoneError, NetworkError
from swarm.messages import Direction


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

    def apply(
        self, device: str, direction: Direction, shape: LinkShape, seat: Seat | None = None
    ) -> None:
        """Shapes one direction and reads it back; when that fails, all is as before. `seat`: the
        link's place in the medium that its shape is a part of.

        Raises NetworkError with the kernel's words, LinkGoneError when the device vanished.
        """
        self._check(direction, shape)
        try:
            if direction == "down" and shape.cell_bps and seat is not None:
                tree.join(device, seat, shape, fq_codel="fq_codel" in self.capabilities().present)
                # Only now, so that the link is shaped all the while.
                _clear_own(device)
            elif direction == "down":
                self._shape(device, shape)
                _leave_tree(device)
            else:
                self._shape_up(device, ifb_of(device), shape)
        except NetworkError as error:
            if not index_of(device):
                raise LinkGoneError(f"interface {device} has vanished: {error}") from error
            raise

    def _check(self, direction: Direction, shape: LinkShape) -> None:
        missing = self.capabilities().missing
        alone = direction == "down" and not shape.cell_bps
        needed = NEEDED if alone else (*NEEDED, *NEEDED_UP)
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
            make_ifb(ifb, device)
            self._shape(ifb, shape)
            hook(device, "up", Queue(ifb))
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
                self._write(device, shape_of(before), shaped=True)
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
        wrong = list(differences(reading, shape))
        if wrong:
            raise NetworkError(f"{device} has another shape than it should: {'; '.join(wrong)}")


def queueing_device(device: str, direction: Direction) -> str:
    """The name of the device whose HTB queues a direction of what goes through a device, where no
    tree does."""
    return device if direction == "down" else ifb_of(device)


def clear(device: str, direction: Direction) -> None:
    """Makes one direction unshaped; no error when it is so already, or the device is gone.

    Raises NetworkError with the kernel's words when the shape stays.
    """
    if direction == "down":
        _leave_tree(device)
        _clear_own(device)
    else:
        unhook(device, "up")
        # Only now: what a redirection sends to an `ifb` that is no more is lost.
        remove_ifb(ifb_of(device))


def _leave_tree(device: str) -> None:
    queue = hooks_of(device).get("down")
    if queue is not None:
        unhook(device, "down")
        tree.leave(queue)


def _clear_own(device: str) -> None:
    done = attempt("tc", "qdisc", "del", "dev", device, "root")
    if done.returncode == 0:
        return
    if "qdisc htb 1: root" in attempt("tc", "qdisc", "show", "dev", device).stdout:
        raise NetworkError(f"tc does not clear {device} down: {words(done)}")


def forget(devices: Iterable[tuple[str, Seat]]) -> None:
    """Removes what outlives those of these devices that have vanished."""
    for device, seat in devices:
        if not index_of(device):
            clear(device, "up")
            tree.forget(seat)


def read(devices: Collection[tuple[str, Direction]]) -> Mapping[tuple[str, Direction], LinkReading]:
    """Readings of directions of devices; those that are not shaped are left out."""
    names = {name for d, way in devices for name in (d, queueing_device(d, way))}
    seen = read_devices(sorted(names))
    readings = dict(seen.readings)
    trees = {to.device for to in seen.hooks.values()} - names
    if trees:
        readings.update(read_devices(sorted(trees)).readings)
    found = {}
    for place in devices:
        queue = seen.hooks.get(place)
        if queue is None and place[1] == "down":
            queue = Queue(place[0])
        if queue in readings:
            found[place] = readings[queue]
    return found


def _filters(device: str) -> str:
    return f"filter show dev {device} parent 1:\n"


def _reading(device: str, text: str) -> LinkReading | None:
    """A device's shape in what `tc` shows of it; None unless it is whole, filters and all."""
    reading = parse(text, [device]).get(Queue(device))
    if (
        reading is None
        or set(reading.classes) != set(htb.NUMBERS)
        or filters(text) != htb.filters()
    ):
        return None
    return reading
