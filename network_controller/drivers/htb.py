"""HTB by traffic class: the `tc` lines that give a device a shape.

1:  root, default 1:30
└── 1:1    the capacity
    ├── 1:5   bare acknowledgements of TCP, of whatever class
    ├── 1:10  control      by DSCP EF, and ARP: without it nobody finds anybody
    ├── 1:20  fusion       by DSCP AF41
    └── 1:30  background   by DSCP CS1, and whatever carries no mark

Links that share a medium have one tree, each of them a slot of it (here the second):

1:  root, default 1:2
└── 1:1    what the medium carries
    ├── 1:2    what is for no link in particular, such as ARP
    └── 1:200  the link's guarantee, up to what it may have at most; by the robot's address
        ├── 1:205, 1:210, 1:220, 1:230   the classes, as above
"""

from __future__ import annotations

from collections.abc import Iterator
from ipaddress import IPv4Address

from network_controller.model import LinkShape
from swarm.traffic import TrafficClass

ACKS = 5
"""What goes the other way waits for its acknowledgements: behind a full queue of this way they come
seconds late, and a wide way stands still. So they go first (RFC 3449, section 5.4.2)."""
ACKS_BPS = 1_000
"""Guaranteed to them, so little that all guarantees still fit; they borrow as control does."""
_ACK = (
    "match u8 0x05 0x0f at 0 match u16 0x0000 0xff80 at 2 match ip protocol 6 0xff "
    "match u8 0x10 0xff at 33"
)
"""A header without options, less than 128 bytes in all, TCP, ACK and no other flag."""
_ACK_SHOWN = ("05000000/0f00ff80 at 0", "00060000/00ff0000 at 8", "00100000/00ff0000 at 32")
"""That, as `tc filter show` prints it."""
NUMBERS = {TrafficClass.CONTROL: 10, TrafficClass.FUSION: 20, TrafficClass.BACKGROUND: 30}
DSCP_MASK = 0xFC
DESTINATION = 16
"""Where an IPv4 header has it, in bytes."""
BURST_S = 0.02
"""What may go out at once: a scheduler that wakes a few milliseconds late loses no tokens."""
MIN_BURST_BYTES = 3_200
"""Two packets of 1,500 bytes and their headers."""
QUANTUM_S = 0.001
MIN_QUANTUM_BYTES, MAX_QUANTUM_BYTES = 1_600, 60_000
"""HTB's own limits: one packet, and what it warns of. All classes have the same quantum, so that
those of one priority share what the guarantees leave in equal parts."""
QUEUE_S = 0.1
"""How much a class may queue at the link's rate: about a Wi-Fi access point's buffer."""
MIN_QUEUE_BYTES = 64 * 1024
"""Half a second at 1 Mbit/s. In single runs TCP that just had a faster link delivered 98 % of
1 Mbit/s with it, by BBR and by CUBIC; CUBIC lost a quarter of that with 32 kB, and half of it with
128 kB. A lump of a whole 64 kB from a sender that still believes in the old rate is refused; it
comes back in pieces."""
TARGET_MS, TARGET_PACKETS = 5.0, 1.5
"""fq_codel's target delay; at low rates as long as it takes to send a packet and a half, or every
packet would come too late (RFC 8289, section 4.3)."""
FULL_PACKET_BYTES = 1514
MAX_SLOTS = 254
OTHERS_BPS = 8_000
"""Guaranteed to what is for no link in particular; it is served first with what is left."""


def lines(device: str, shape: LinkShape, *, shaped: bool, fq_codel: bool) -> list[str]:
    """The lines for `tc -batch` that shape what leaves through a device.

    Where it is `shaped` already, its classes change in place and its queues keep what they hold.
    """
    root = [] if shaped else [f"qdisc add dev {device} root handle 1: htb default 30"]
    return [
        *root,
        _class(device, "1:", "1:1", shape.capacity_bps, shape.capacity_bps, shape),
        *_leaves(device, shape, 0),
        *_queues(device, shape, fq_codel, 0),
        *([] if shaped else _filters(device)),
    ]


def root_lines(device: str, shape: LinkShape, *, shaped: bool) -> list[str]:
    """The lines that give a device the tree of a medium, or change what the medium carries."""
    root = [] if shaped else [f"qdisc add dev {device} root handle 1: htb default 2"]
    return [
        *root,
        _class(device, "1:", "1:1", shape.cell_bps, shape.cell_bps, shape),
        _class(device, "1:1", "1:2", OTHERS_BPS, shape.cell_bps, shape, 0),
        f"qdisc replace dev {device} parent 1:2 bfifo limit {MIN_QUEUE_BYTES}",
    ]


def slot_lines(
    device: str, shape: LinkShape, slot: int, address: str, *, shaped: bool, fq_codel: bool
) -> list[str]:
    """The lines that give a link a slot of a tree, or change it in place."""
    own = minor(slot, 0)
    return [
        _class(device, "1:1", f"1:{own}", shape.capacity_bps, shape.ceil_bps, shape),
        *_leaves(device, shape, slot),
        *_queues(device, shape, fq_codel, slot),
        *([] if shaped else _slot_filters(device, slot, address)),
    ]


def leave_lines(device: str, slot: int) -> list[str]:
    """The lines that take a slot away; some may fail where it is not whole."""
    classes = [minor(slot, number) for number in (ACKS, *NUMBERS.values(), 0)]
    return [
        f"filter del dev {device} parent 1: pref {slot}",
        *(f"class del dev {device} classid 1:{one}" for one in classes),
    ]


def minor(slot: int, number: int) -> str:
    """The name of a class: of slot 0 its number, else the slot's and that one."""
    return f"{slot:x}{number:02d}" if slot else str(number)


def slot_of(name: str) -> tuple[int, str]:
    """The slot of a class's name, and the rest of it: a class's number, or `00` of a link's own."""
    return int(name[:-2] or "0", 16), name[-2:]


def burst_bytes(rate_bps: int) -> int:
    """The depth of a class's bucket."""
    return max(MIN_BURST_BYTES, int(rate_bps / 8 * BURST_S))


def _class(
    device: str,
    parent: str,
    name: str,
    rate_bps: int,
    ceil_bps: int,
    shape: LinkShape,
    priority: int | None = None,
) -> str:
    # That of the whole tree, for its leaves share what is left by it.
    quantum = int((shape.cell_bps or shape.capacity_bps) / 8 * QUANTUM_S)
    quantum = min(MAX_QUANTUM_BYTES, max(MIN_QUANTUM_BYTES, quantum))
    return (
        f"class replace dev {device} parent {parent} classid {name} htb "
        f"rate {rate_bps}bit ceil {ceil_bps}bit "
        f"{'' if priority is None else f'prio {priority} '}"
        f"burst {burst_bytes(rate_bps)}b cburst {burst_bytes(ceil_bps)}b quantum {quantum}"
    )


def _leaves(device: str, shape: LinkShape, slot: int) -> Iterator[str]:
    parent = f"1:{minor(slot, 0)}" if slot else "1:1"
    ceil_bps = max(one.ceil_bps for one in shape.classes.values())
    yield _class(device, parent, f"1:{minor(slot, ACKS)}", ACKS_BPS, ceil_bps, shape, 0)
    for traffic, number in NUMBERS.items():
        one = shape.classes[traffic]
        name = f"1:{minor(slot, number)}"
        yield _class(device, parent, name, one.rate_bps, one.ceil_bps, shape, one.priority)


def _queues(device: str, shape: LinkShape, fq_codel: bool, slot: int) -> Iterator[str]:
    limit = max(MIN_QUEUE_BYTES, int(shape.capacity_bps / 8 * QUEUE_S))
    if shape.delay_ms or shape.loss:
        held = int(shape.capacity_bps / 8 * shape.delay_ms * 1e-3)
        packets = max(1000, (limit + held) // 1000)
        queue = f"netem delay {shape.delay_ms:g}ms loss {100 * shape.loss:g}% limit {packets}"
    elif fq_codel:
        target = max(TARGET_MS, 8e3 * TARGET_PACKETS * FULL_PACKET_BYTES / shape.capacity_bps)
        # Its limit counts the memory of packets, which is about twice what they weigh.
        queue = (
            f"fq_codel target {target:.1f}ms interval {20 * target:.0f}ms memory_limit {2 * limit}"
        )
    else:
        queue = f"bfifo limit {limit}"
    # Without a handle: the kernel changes a queue of the same kind in place and replaces one of
    # another kind, but refuses a handle that a queue of another kind has already.
    for number in (ACKS, *NUMBERS.values()):
        yield f"qdisc replace dev {device} parent 1:{minor(slot, number)} {queue}"


def _filters(device: str) -> Iterator[str]:
    yield f"filter add dev {device} parent 1: protocol ip prio 1 u32 {_ACK} flowid 1:{ACKS}"
    for priority, (traffic, number) in enumerate(NUMBERS.items(), start=2):
        yield (
            f"filter add dev {device} parent 1: protocol ip prio {priority} u32 "
            f"match ip dsfield {traffic.tos:#04x} {DSCP_MASK:#04x} flowid 1:{number}"
        )
    yield f"filter add dev {device} parent 1: protocol arp prio 5 u32 match u32 0 0 flowid 1:10"


def _slot_filters(device: str, slot: int, address: str) -> Iterator[str]:
    rule = (
        f"filter add dev {device} parent 1: protocol ip prio {slot} u32 match ip dst {address}/32"
    )
    yield f"{rule} {_ACK} flowid 1:{minor(slot, ACKS)}"
    for traffic, number in NUMBERS.items():
        # The last one is background's, and takes what carries no mark, too.
        last = traffic is TrafficClass.BACKGROUND
        mark = "" if last else f"match ip dsfield {traffic.tos:#04x} {DSCP_MASK:#04x} "
        yield f"{rule} {mark}flowid 1:{minor(slot, number)}"


def filters() -> frozenset[tuple[str, tuple[str, ...]]]:
    """What `tc filter show` prints of the filters: a class's name, and `value/mask at place`."""
    marks = {(str(number), (_mark(traffic),)) for traffic, number in NUMBERS.items()}
    arp = (str(NUMBERS[TrafficClass.CONTROL]), ("00000000/00000000 at 0",))
    return frozenset(marks | {arp, (str(ACKS), _ACK_SHOWN)})


def destination(address: str) -> str:
    """The match of an IPv4 address that packets go to, as `tc filter show` prints it."""
    return f"{int(IPv4Address(address)):08x}/ffffffff at {DESTINATION}"


def slot_filters(slot: int, to: str) -> frozenset[tuple[str, tuple[str, ...]]]:
    """What it prints of the filters of a slot, whose packets go to `to`; see `destination`."""
    marks = {
        (minor(slot, number), (to,) if traffic is TrafficClass.BACKGROUND else (to, _mark(traffic)))
        for traffic, number in NUMBERS.items()
    }
    return frozenset(marks | {(minor(slot, ACKS), (to, *_ACK_SHOWN))})


def _mark(traffic: TrafficClass) -> str:
    return f"00{traffic.tos:02x}0000/00{DSCP_MASK:02x}0000 at 0"
