"""HTB by traffic class: the `tc` lines that give a device a shape.

1:  root, default 1:30
└── 1:1    the capacity
    ├── 1:10  control      by DSCP EF, and ARP: without it nobody finds anybody
    ├── 1:20  fusion       by DSCP AF41
    └── 1:30  background   by DSCP CS1, and whatever carries no mark
"""

from __future__ import annotations

from collections.abc import Iterator

from network_controller.model import LinkShape
from swarm.traffic import TrafficClass

NUMBERS = {TrafficClass.CONTROL: 10, TrafficClass.FUSION: 20, TrafficClass.BACKGROUND: 30}
DSCP_MASK = 0xFC
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


def lines(device: str, shape: LinkShape, *, shaped: bool, fq_codel: bool) -> list[str]:
    """The lines for `tc -batch` that shape what leaves through a device.

    Where it is `shaped` already, its classes change in place and its queues keep what they hold.
    """
    root = [] if shaped else [f"qdisc add dev {device} root handle 1: htb default 30"]
    return [
        *root,
        *_classes(device, shape),
        *_queues(device, shape, fq_codel),
        *([] if shaped else _filters(device)),
    ]


def burst_bytes(rate_bps: int) -> int:
    """The depth of a class's bucket."""
    return max(MIN_BURST_BYTES, int(rate_bps / 8 * BURST_S))


def _classes(device: str, shape: LinkShape) -> Iterator[str]:
    capacity = shape.capacity_bps
    burst = burst_bytes(capacity)
    quantum = int(capacity / 8 * QUANTUM_S)
    quantum = min(MAX_QUANTUM_BYTES, max(MIN_QUANTUM_BYTES, quantum))
    yield (
        f"class replace dev {device} parent 1: classid 1:1 htb rate {capacity}bit "
        f"ceil {capacity}bit burst {burst}b cburst {burst}b quantum {quantum}"
    )
    for traffic, number in NUMBERS.items():
        wanted = shape.classes[traffic]
        yield (
            f"class replace dev {device} parent 1:1 classid 1:{number} htb "
            f"rate {wanted.rate_bps}bit ceil {wanted.ceil_bps}bit prio {wanted.priority} "
            f"burst {burst_bytes(wanted.rate_bps)}b cburst {burst_bytes(wanted.ceil_bps)}b "
            f"quantum {quantum}"
        )


def _queues(device: str, shape: LinkShape, fq_codel: bool) -> Iterator[str]:
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
    for number in NUMBERS.values():
        yield f"qdisc replace dev {device} parent 1:{number} {queue}"


def _filters(device: str) -> Iterator[str]:
    for priority, (traffic, number) in enumerate(NUMBERS.items(), start=1):
        yield (
            f"filter add dev {device} parent 1: protocol ip prio {priority} u32 "
            f"match ip dsfield {traffic.tos:#04x} {DSCP_MASK:#04x} flowid 1:{number}"
        )
    yield f"filter add dev {device} parent 1: protocol arp prio 4 u32 match u32 0 0 flowid 1:10"


def filters() -> frozenset[tuple[int, str]]:
    """What `tc filter show` prints of the filters: a class's number and `value/mask`."""
    marks = {
        (number, f"00{traffic.tos:02x}0000/00{DSCP_MASK:02x}0000")
        for traffic, number in NUMBERS.items()
    }
    return frozenset(marks | {(NUMBERS[TrafficClass.CONTROL], "00000000/00000000")})
