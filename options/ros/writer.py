"""Writing CDR, the encoding of ROS 2 messages (OMG DDSI-RTPS 2.5, section 10; version 1 of XCDR).

Little endian; every number lies at a multiple of its own size, counted from behind the four bytes
of encapsulation.
"""

from __future__ import annotations

import math
import struct

_ENCAPSULATION = b"\x00\x01\x00\x00"
NS = 1_000_000_000


class Writer:
    """Writes one message from front to back."""

    def __init__(self) -> None:
        self._body = bytearray()

    def put(self, code: str, *values: float) -> Writer:
        """Numbers of one kind; `code` is one of `struct`: B, i, I, f, d and so on."""
        self._body += b"\0" * (-len(self._body) % struct.calcsize(code))
        self._body += struct.pack(f"<{len(values)}{code}", *values)
        return self

    def text(self, text: str) -> Writer:
        """A string; its length counts the zero byte at its end."""
        raw = text.encode() + b"\0"
        self.put("I", len(raw))
        self._body += raw
        return self

    def octets(self, data: bytes) -> Writer:
        """A sequence of bytes."""
        self.put("I", len(data))
        self._body += data
        return self

    def header(self, stamp_ns: int, frame: str) -> Writer:
        """A `std_msgs/Header`."""
        return self.put("i", stamp_ns // NS).put("I", stamp_ns % NS).text(frame)

    def pose(self, center: tuple[float, ...], heading: float) -> Writer:
        """A `geometry_msgs/Pose` upright at a place in metres, turned by radians about z."""
        return self.put("d", *center, 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))

    def message(self) -> bytes:
        """All that was written, as it goes over the wire."""
        return _ENCAPSULATION + bytes(self._body)
