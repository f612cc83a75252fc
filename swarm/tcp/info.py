"""What the kernel says of this process's own TCP connections (`TCP_INFO`); no privileges needed.

Zenoh does not give its sockets away, so they are found among the process's descriptors. A traffic
class has a connection of its own, which is known by the mark of its packets.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from swarm.traffic import TrafficClass

_FIELDS = struct.Struct("=8B24IQQQQIIIIIIQQQQ")
"""`struct tcp_info` of linux/tcp.h as far as Linux 4.10 has it."""
_BACKOFF = 4
_MSS, _HEARD = 10, 19
_UNACKED, _RTT, _BYTES_ACKED, _BYTES_RECEIVED, _NOTSENT, _MIN_RTT = 12, 23, 34, 35, 38, 39
_BUSY, _RWND_LIMITED, _SNDBUF_LIMITED = 43, 44, 45
LONE_PACKETS = 2
"""So few may be under way because their acknowledgement is delayed (RFC 1122, 4.2.3.2)."""
QUEUED_US = 5_000
"""A round trip that is longer than twice the shortest one, and by this much, has met a queue."""
_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True, slots=True)
class Connection:
    """One end of a TCP connection of this process."""

    descriptor: int
    inode: str
    local: str
    """Address and port, `10.77.1.1:40332`."""
    peer: str


@dataclass(frozen=True, slots=True)
class TcpInfo:
    """The sender's side of a connection; counters begin with the connection."""

    acked_bytes: int
    queued: bool
    """Bytes wait: in the socket, since nothing more may be under way, or in a queue behind it,
    since what is under way stays so for long."""
    busy_us: int
    """Time with data under way."""
    held_us: int
    """Of that, the time in which the receiver's window or the send buffer held data up."""
    backoff: int
    """How often in a row what was sent was not acknowledged in time."""
    segment_bytes: int
    """What a full packet carries."""
    heard_ms: int
    """Since the other end has sent anything."""
    received_bytes: int = 0
    """From the other end."""


def tcp_info(descriptor: int) -> TcpInfo | None:
    """What the kernel says of a descriptor; None where it is no TCP socket (any more)."""
    buffer = ctypes.create_string_buffer(_FIELDS.size)
    length = ctypes.c_uint32(_FIELDS.size)
    failed = _libc.getsockopt(
        descriptor, socket.IPPROTO_TCP, socket.TCP_INFO, buffer, ctypes.byref(length)
    )
    if failed or length.value < _FIELDS.size:
        return None
    told = _FIELDS.unpack(buffer.raw)
    behind = told[_UNACKED] > LONE_PACKETS and told[_RTT] > 2 * told[_MIN_RTT] + QUEUED_US
    held_us = told[_RWND_LIMITED] + told[_SNDBUF_LIMITED]
    return TcpInfo(
        told[_BYTES_ACKED],
        told[_NOTSENT] > 0 or behind,
        told[_BUSY],
        held_us,
        told[_BACKOFF],
        told[_MSS],
        told[_HEARD],
        told[_BYTES_RECEIVED],
    )


def connections(traffic: TrafficClass) -> Iterator[Connection]:
    """This process's established TCP connections of a traffic class."""
    for name in os.listdir("/proc/self/fd"):
        try:
            inode = os.readlink(f"/proc/self/fd/{name}")
            if not inode.startswith("socket:"):
                continue
            with _copy(int(name)) as held:
                if held.family not in (socket.AF_INET, socket.AF_INET6):
                    continue
                if held.type != socket.SOCK_STREAM or _tos(held) != traffic.tos:
                    continue
                local, peer = held.getsockname(), held.getpeername()
        except OSError:
            continue  # It listens, or is closed by now.
        yield Connection(int(name), inode, _written(local), _written(peer))


def limit_silence(descriptor: int, silent_ms: int) -> None:
    """Has a connection fail once what it has sent is not acknowledged for so long (RFC 5482). Does
    nothing where the descriptor is no TCP socket (any more)."""
    with suppress(OSError), _copy(descriptor) as held:
        held.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, silent_ms)


def _copy(descriptor: int) -> socket.socket:
    """Another descriptor of a socket, as who owns it may close it at any time. Raises OSError."""
    copied = os.dup(descriptor)
    try:
        return socket.socket(fileno=copied)
    except OSError:
        os.close(copied)  # It was closed, and its number is that of another file by now.
        raise


def _tos(held: socket.socket) -> int:
    if held.family == socket.AF_INET6:
        return held.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_TCLASS)
    return held.getsockopt(socket.IPPROTO_IP, socket.IP_TOS)


def _written(address: tuple[str, int]) -> str:
    return f"{address[0]}:{address[1]}"
