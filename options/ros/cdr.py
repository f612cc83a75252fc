"""Reading CDR, the encoding of ROS 2 messages (OMG DDSI-RTPS 2.5, section 10; version 1 of XCDR).

Four bytes say the byte order; after them every number lies at a multiple of its own size.
"""

from __future__ import annotations

import struct

_ORDERS = {0: ">", 1: "<"}
_ALLOWED = "0 (big endian) or 1 (little endian)"


class CdrError(ValueError):
    """A message that is not what its type says."""


class Cursor:
    """Reads one message from front to back. Every method raises CdrError beyond its end."""

    def __init__(self, message: bytes | memoryview) -> None:
        """`message` with its four bytes of encapsulation."""
        whole = memoryview(message)
        if len(whole) < 4:
            raise CdrError(f"it has {len(whole)} bytes; a CDR message has at least 4")
        kind = int.from_bytes(whole[:2], "big")
        if kind not in _ORDERS:
            raise CdrError(f"its encapsulation is {kind}; allowed: {_ALLOWED}")
        self.order = _ORDERS[kind]
        self._body = whole[4:]
        self._at = 0

    def doubles(self, count: int) -> tuple[float, ...]:
        """`count` numbers of 8 bytes."""
        return self._unpack("d", count)

    def whole(self, code: str) -> int:
        """One integer; `code` is one of `struct`: B, i, I and so on."""
        return int(self._unpack(code, 1)[0])

    def text(self) -> str:
        """A string; its length counts the zero byte at its end."""
        raw = bytes(self._take(self.whole("I")))
        return raw.rstrip(b"\0").decode("utf-8", errors="replace")

    def octets(self) -> memoryview:
        """A sequence of bytes, not copied."""
        return self._take(self.whole("I"))

    def count(self, least_bytes: int) -> int:
        """The length of a sequence whose elements take at least that many bytes each."""
        count = self.whole("I")
        if count * least_bytes > len(self._body) - self._at:
            raise CdrError(f"it names a sequence of {count}, more than its bytes can hold")
        return count

    def stamp(self) -> int:
        """A `builtin_interfaces/Time`, in nanoseconds."""
        return self.whole("i") * 1_000_000_000 + self.whole("I")

    def _unpack(self, code: str, count: int) -> tuple[float, ...]:
        size = struct.calcsize(code)
        self._at += -self._at % size
        raw = self._take(size * count)
        return struct.unpack(f"{self.order}{count}{code}", raw)

    def _take(self, size: int) -> memoryview:
        end = self._at + size
        if end > len(self._body):
            raise CdrError(f"it ends after {len(self._body) + 4} bytes, {end + 4} are needed")
        part = self._body[self._at : end]
        self._at = end
        return part
