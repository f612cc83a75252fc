"""Unpacks what bags hold compressed, which may be far more than it is worth (a bomb): how much it
is gets checked first."""

from __future__ import annotations

import lz4.frame
import zstandard

MAX_UNPACKED_BYTES = 64 << 20
"""Of what is unpacked at once: a message of a bag, or a chunk of them."""
SMALL_BYTES, MAX_RATIO = 4 << 20, 250
"""More than that much is unpacked only from at least a `MAX_RATIO`th: recorded data is far from
it, a bomb is beyond it."""


def unzstd(packed: bytes, announced: int | None = None) -> bytes:
    """What was compressed with Zstandard: `announced` bytes, where that is known.

    Raises ValueError where it is more than is allowed, and zstandard.ZstdError.
    """
    told = zstandard.frame_content_size(packed)
    size = announced if told < 0 else told
    if size is not None:
        check_unpacked(size, len(packed))
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    with zstandard.ZstdDecompressor(max_window_size=1 << 25).stream_reader(packed) as reader:
        found: bytes = reader.read(MAX_UNPACKED_BYTES + 1)
    check_unpacked(len(found), len(packed))
    return found


def unlz4(packed: bytes, announced: int) -> bytes:
    """What was compressed with LZ4, in `announced` bytes.

    Raises ValueError where it is another number or more than is allowed, and RuntimeError.
    """
    check_unpacked(announced, len(packed))
    found: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=announced + 1)
    if len(found) != announced:
        raise ValueError(f"it holds {len(found)} bytes or more, not {announced}")
    return found


def check_unpacked(size: int, packed: int) -> None:
    """Raises ValueError where so much may not be unpacked from `packed` bytes."""
    if size > MAX_UNPACKED_BYTES:
        raise ValueError(f"it unpacks to {size} bytes; allowed: {MAX_UNPACKED_BYTES}")
    if size > max(SMALL_BYTES, MAX_RATIO * packed):
        raise ValueError(
            f"it unpacks to {size} bytes, {size // max(1, packed)} times as much as it has; "
            f"allowed: {MAX_RATIO} times"
        )
