"""One HTB tree for all links that share a medium: they lend each other what they leave unused.

    link1 ── clsact ──┐
    link2 ── clsact ──┴─► ifb-<bridge>, with the HTB ──► the link that a packet was on its way to

Each link has a slot of the tree, which is told by its robot's address (`htb.py`).
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from network_controller.drivers import htb
from network_controller.drivers.command import attempt, words
from network_controller.drivers.compare import differences, shape_of
from network_controller.drivers.hooks import hook, unhook
from network_controller.drivers.ifbs import ifb_of, is_ours, make_ifb, remove_ifb
from network_controller.drivers.interfaces import index_of
from network_controller.drivers.readings import filters, parse
from network_controller.model import LinkReading, LinkShape, Queue
from swarm.errors import NetworkError


class Seat(NamedTuple):
    """What a link's place in a tree follows from."""

    bridge: str
    """That the links of the medium hang on."""
    address: str
    """The robot's, IPv4."""


class _Tree(NamedTuple):
    rooted: bool
    readings: dict[int, LinkReading]
    """By slot, those that are whole."""
    addresses: dict[int, str]
    """What each slot's first filter asks for, in tc's words."""


def join(device: str, seat: Seat, shape: LinkShape, *, fq_codel: bool) -> None:
    """Gives a link its slot or changes it in place, reads it back, and sends what leaves its
    device there. When anything fails, all is as before.

    Raises NetworkError with the kernel's words.
    """
    ifb = ifb_of(seat.bridge)
    make_ifb(ifb, seat.bridge)
    tree = _parse(ifb, attempt("tc", "-batch", "-", text=_show(ifb)).stdout)
    slot = _slot(tree, seat.address)
    before = tree.readings.get(slot)
    try:
        if not tree.rooted:
            attempt("tc", "qdisc", "del", "dev", ifb, "root")
        if before is None:
            # Half of a slot that somebody left.
            _drop(ifb, slot)
        _write(ifb, seat, slot, shape, rooted=tree.rooted, shaped=before is not None, fq=fq_codel)
        hook(device, "down", Queue(ifb, slot))
    except NetworkError as error:
        if before is None:
            with suppress(NetworkError):
                unhook(device, "down")
                leave(Queue(ifb, slot))
            raise
        try:
            _write(ifb, seat, slot, shape_of(before), rooted=True, shaped=True, fq=fq_codel)
        except NetworkError as again:
            raise NetworkError(f"{error}; nor can its last shape be restored: {again}") from error
        raise


def leave(queue: Queue) -> None:
    """Frees a slot to which nothing is redirected any more; the tree goes with the last one.
    Raises NetworkError when that stays."""
    if not is_ours(queue.device):
        return
    _drop(queue.device, queue.slot)
    shown = attempt("tc", "-batch", "-", text=_show(queue.device)).stdout
    if not _parse(queue.device, shown).addresses:
        remove_ifb(queue.device)


def forget(seat: Seat) -> None:
    """Frees the slot of a link that is gone."""
    ifb = ifb_of(seat.bridge)
    if not index_of(ifb):
        return
    tree = _parse(ifb, attempt("tc", "-batch", "-", text=_show(ifb)).stdout)
    slot = _slot(tree, seat.address)
    if slot in tree.addresses:
        with suppress(NetworkError):
            leave(Queue(ifb, slot))


def _write(
    ifb: str, seat: Seat, slot: int, shape: LinkShape, *, rooted: bool, shaped: bool, fq: bool
) -> None:
    """Changes a slot and reads it back, by one process."""
    lines = htb.root_lines(ifb, shape, shaped=rooted)
    lines += htb.slot_lines(ifb, shape, slot, seat.address, shaped=shaped, fq_codel=fq)
    text = "\n".join(lines) + "\n" + _show(ifb)
    done = attempt("tc", "-batch", "-", text=text)
    if done.returncode != 0:
        raise NetworkError(f"tc refuses to shape {seat.address} on {ifb}: {words(done, text)}")
    reading = _parse(ifb, done.stdout).readings.get(slot)
    if reading is None:
        raise NetworkError(f"{ifb} should shape {seat.address}, but `tc` shows no whole shape")
    if wrong := list(differences(reading, shape)):
        raise NetworkError(
            f"{ifb} has another shape for {seat.address} than it should: {'; '.join(wrong)}"
        )


def _drop(ifb: str, slot: int) -> None:
    text = "\n".join(htb.leave_lines(ifb, slot)) + "\n"
    attempt("tc", "-force", "-batch", "-", text=text)


def _slot(tree: _Tree, address: str) -> int:
    """The slot of an address, else the first free one. Raises NetworkError when all are taken."""
    wanted = htb.destination(address)
    for slot, found in tree.addresses.items():
        if found == wanted:
            return slot
    free = (slot for slot in range(1, htb.MAX_SLOTS + 1) if slot not in tree.addresses)
    slot = next(free, 0)
    if not slot:
        raise NetworkError(f"one medium can have {htb.MAX_SLOTS} links; {address} is one more")
    return slot


def _parse(ifb: str, text: str) -> _Tree:
    found = parse(text, [ifb])
    rules = filters(text)
    addresses = {htb.slot_of(name)[0]: matches[0] for name, matches in rules}
    whole = {
        queue.slot: reading
        for queue, reading in found.items()
        if set(reading.classes) == set(htb.NUMBERS)
        and {rule for rule in rules if htb.slot_of(rule[0])[0] == queue.slot}
        == htb.slot_filters(queue.slot, addresses.get(queue.slot, ""))
    }
    return _Tree("qdisc htb 1: root" in text, whole, addresses)


def _show(ifb: str) -> str:
    return f"qdisc show dev {ifb}\nclass show dev {ifb}\nfilter show dev {ifb} parent 1:\n"
