"""Recorded capacity in Mahimahi's format: one line for each packet that the link could carry.

A line is the millisecond since the beginning at which 1,500 bytes could leave; equal lines are
several packets. The recording repeats after its last time. (Netravali et al., "Mahimahi: Accurate
Record-and-Replay for HTTP", USENIX ATC 2015.)
"""

from __future__ import annotations

import math
from pathlib import Path

from swarm.errors import NetworkError

PACKET_BYTES = 1_500
MAX_MS = 24 * 3600 * 1000
MAX_LINES = 20_000_000


def read_trace(path: Path, interval_s: float = 1.0) -> tuple[int, ...]:
    """The mean capacity of each interval in bit/s, from the beginning of a trace to its end.

    A last interval that the trace does not fill is left out, unless it is the only one: then it is
    taken as long as the trace. Raises NetworkError that names the line for what is no trace.
    """
    packets: dict[int, int] = {}
    last_ms, number = 0, 0
    try:
        with open(path, encoding="ascii") as lines:
            for number, line in enumerate(lines, start=1):
                time_ms = _time(path, number, line, last_ms)
                last_ms = time_ms
                # A packet at the very end of an interval belongs to it.
                at = max(0, math.ceil(time_ms / (1e3 * interval_s)) - 1)
                packets[at] = packets.get(at, 0) + 1
    except (OSError, UnicodeDecodeError) as error:
        raise NetworkError(f"trace {str(path)!r} cannot be read: {error}") from error
    if last_ms == 0:
        raise NetworkError(f"trace {str(path)!r} has {number} lines and lasts 0 ms; it needs more")
    whole = int(last_ms / (1e3 * interval_s))
    bits = PACKET_BYTES * 8
    if whole == 0:
        return (round(sum(packets.values()) * bits / (last_ms * 1e-3)),)
    return tuple(round(packets.get(i, 0) * bits / interval_s) for i in range(whole))


def _time(path: Path, number: int, line: str, last_ms: int) -> int:
    text = line.strip()
    where = f"trace {str(path)!r} line {number}"
    if number > MAX_LINES:
        raise NetworkError(f"{where}: a trace has at most {MAX_LINES} lines")
    if not (text.isascii() and text.isdigit()) or len(text) > 12:
        raise NetworkError(
            f"{where} is {text[:40]!r}; it must be a whole number of milliseconds, at most {MAX_MS}"
        )
    time_ms = int(text)
    if time_ms > MAX_MS:
        raise NetworkError(f"{where} is {time_ms}; a trace may last {MAX_MS} ms")
    if time_ms < last_ms:
        raise NetworkError(f"{where} is {time_ms}, after {last_ms}: times must not go back")
    return time_ms
