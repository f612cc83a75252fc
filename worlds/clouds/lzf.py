"""LZF, in which the Point Cloud Library compresses its files (Lehmann's liblzf, format 1)."""

from __future__ import annotations


def decompress(data: bytes, size: int) -> bytes:
    """The `size` bytes that were compressed. Raises ValueError where the data is not that."""
    out = bytearray()
    at = 0
    try:
        while at < len(data) and len(out) <= size:
            control = data[at]
            at += 1
            if control < 32:
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - data[at] - 1
            at += 1
            if start < 0:
                raise ValueError("it refers to what is before its start")
            # A match may reach into what it writes itself: then it repeats.
            match = out[start : start + length + 2]
            repeats = -(-(length + 2) // len(match))
            out += (match * repeats)[: length + 2]
    except IndexError as error:
        raise ValueError("it ends within an instruction") from error
    if len(out) != size:
        raise ValueError(f"it holds {len(out)} bytes, {size} were announced")
    return bytes(out)
