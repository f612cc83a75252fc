"""What passes an interface, by traffic class: read from the packets themselves."""

from __future__ import annotations

import socket
import struct
import threading
from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

from swarm.defaults import ROUTER_PORT
from swarm.traffic import TrafficClass

_ALL, _IPV4, _TCP = 0x0003, 0x0800, 6
"""A bridge takes its ports' packets before who asks for one protocol sees them."""
_DSCP = 0xFC
"""The two other bits of the byte tell of congestion."""
PORTS = {ROUTER_PORT + cls.value.port_offset: cls for cls in TrafficClass}
DATA_BYTES = 200
"""A packet with less is Zenoh's own: that a link is still there."""


class Packet(NamedTuple):
    """What is counted of a packet: the class of its router's port, its mark, its payload."""

    cls: TrafficClass
    tos: int
    payload: int


def read(data: bytes) -> Packet | None:
    """A packet from its first bytes, beginning with IP's; None for one of no router's."""
    if len(data) < 40 or data[9] != _TCP:
        return None
    head = (data[0] & 0x0F) * 4
    source, target = struct.unpack_from("!HH", data, head)
    cls = PORTS.get(source) or PORTS.get(target)
    if cls is None:
        return None
    (length,) = struct.unpack_from("!H", data, 2)
    return Packet(cls, data[1] & _DSCP, length - head - (data[head + 12] >> 4) * 4)


class Sniffer:
    """Counts until it is closed; needs CAP_NET_RAW where the interfaces are."""

    def __init__(self, devices: Iterable[str]) -> None:
        self._sockets = [_listening(device) for device in devices]
        self._lock = threading.Lock()
        self.packets: Counter[tuple[TrafficClass, int]] = Counter()
        """With payload, by class and mark."""
        self.data: Counter[TrafficClass] = Counter()
        """Payload bytes of packets with more than DATA_BYTES."""
        self._threads = [
            threading.Thread(target=self._count, args=(one,), daemon=True) for one in self._sockets
        ]
        for thread in self._threads:
            thread.start()

    def carried(self, cls: TrafficClass) -> int:
        """Payload bytes of a class so far."""
        with self._lock:
            return self.data[cls]

    def marked(self) -> dict[str, dict[str, int]]:
        """Packets by class and mark."""
        with self._lock:
            return {
                cls.name.lower(): {
                    f"0x{tos:02x}": n for (one, tos), n in self.packets.items() if one is cls
                }
                for cls in TrafficClass
            }

    def kept(self) -> bool:
        """Whether there were packets of control and fusion, and all carry their class's mark."""
        with self._lock:
            seen = {cls for cls, _ in self.packets}
            return {TrafficClass.CONTROL, TrafficClass.FUSION} <= seen and all(
                tos == cls.tos for cls, tos in self.packets
            )

    def close(self) -> None:
        """Counts no more."""
        for one in self._sockets:
            one.close()
        for thread in self._threads:
            thread.join(1.0)

    def _count(self, source: socket.socket) -> None:
        while True:
            try:
                data, (_, protocol, *_) = source.recvfrom(128)
            except TimeoutError:
                if source.fileno() < 0:
                    return
                continue
            except OSError:
                return
            packet = read(data) if protocol == _IPV4 else None
            if packet is not None and packet.payload > 0:
                with self._lock:
                    self.packets[packet.cls, packet.tos] += 1
                    if packet.payload > DATA_BYTES:
                        self.data[packet.cls] += packet.payload


def _listening(device: str) -> socket.socket:
    packets: Any = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL))
    packets.bind((device, _ALL))
    packets.settimeout(0.2)
    made: socket.socket = packets
    return made
