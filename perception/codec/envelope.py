"""The envelope around every encoded payload: magic, version, kind, body, checksum.

0  4 bytes  magic: b"CAP" and the format version
4  1 byte   kind of the body
5  n bytes  body
   4 bytes  CRC-32 (zlib) of everything before it, little endian
"""

from __future__ import annotations

import zlib

from swarm.errors import PayloadError

VERSION = 1
MAGIC = b"CAP"
OVERHEAD = len(MAGIC) + 2 + 4


def seal(kind: int, body: bytes) -> bytes:
    """The payload that carries a body of the given kind (0..255)."""
    head = MAGIC + bytes((VERSION, kind)) + body
    return head + zlib.crc32(head).to_bytes(4, "little")


def unseal(payload: bytes) -> tuple[int, bytes]:
    """Kind and body of a payload.

    Raises PayloadError when it is too short, of another format or version, or damaged.
    """
    if len(payload) < OVERHEAD:
        raise PayloadError(f"payload has {len(payload)} bytes, at least {OVERHEAD} are needed")
    if payload[:3] != MAGIC:
        raise PayloadError(f"payload starts with {payload[:3]!r}, expected {MAGIC!r}")
    if payload[3] != VERSION:
        raise PayloadError(f"payload has format version {payload[3]}, only {VERSION} can be read")
    if zlib.crc32(payload[:-4]) != int.from_bytes(payload[-4:], "little"):
        raise PayloadError(f"payload of {len(payload)} bytes does not match its checksum")
    return payload[4], payload[5:-4]


def inflate(data: bytes, size: int, name: str) -> bytes:
    """Decompressed zlib data that must have exactly `size` bytes; never allocates more.

    Raises PayloadError naming the part.
    """
    unpacker = zlib.decompressobj()
    try:
        raw = unpacker.decompress(data, size + 1)
    except zlib.error as error:
        raise PayloadError(f"{name} cannot be decompressed: {error}") from error
    if len(raw) != size or not unpacker.eof or unpacker.unused_data:
        raise PayloadError(f"{name} does not decompress to the expected {size} bytes")
    return raw
