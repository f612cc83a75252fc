"""Recorded capacity in Mahimahi's format: one line for each packet that the link could carry.

A line is the millisecond since the beginning at which 1,500 bytes could leave; equal lines are
several packets. The recording repeats after its last time. (Netravali et al., "Mahimahi: Accurate
Record-and-Replay for HTTP", USENIX ATC 2015.)
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from swarm.errors import NetworkError

PACKET_BYTES = 1_500
MAX_MS = 24 * 3600 * 1000
MAX_LINES = 20_000_000
MAX_INTERVALS = 100_000
"""As many rates as a request may carry."""
MIN_INTERVAL_S, MAX_INTERVAL_S = 0.1, 3600.0
_LONGEST_LINE = 32


def read_trace(path: Path, interval_s: float = 1.0) -> tuple[int, ...]:
    """The mean capacity of each interval in bit/s, from the beginning of a trace to its end.

    The last interval may end with the trace; its capacity is the mean until then. Where that is
    less than half an interval it is left out, so that the intervals last as long as the trace, as
    nearly as they can. Raises NetworkError that names file and line for what is no trace.
    """
    name = f"trace {str(path)!r}"
    if not MIN_INTERVAL_S <= interval_s <= MAX_INTERVAL_S:
        raise NetworkError(
            f"interval {interval_s:g} s is not possible; allowed are {MIN_INTERVAL_S:g} to "
            f"{MAX_INTERVAL_S:g} s"
        )
    interval_ms = round(1e3 * interval_s, 6)
    packets: Counter[int] = Counter()
    last_ms = number = 0
    try:
        for number, line in enumerate(_lines(path), start=1):
            last_ms = _time(f"{name} line {number}", line, number, last_ms)
            # A packet at the very end of an interval belongs to it.
            packets[max(0, math.ceil(last_ms / interval_ms) - 1)] += 1
    except OSError as error:
        raise NetworkError(f"{name} cannot be read: {error}") from error
    if last_ms == 0:
        what = f"ends at 0 ms after {number} lines" if number else "is empty"
        raise NetworkError(
            f"{name} {what}; it needs a time in ms for each packet, the last one above 0"
        )
    count = max(1, math.floor(last_ms / interval_ms + 0.5))
    if count > MAX_INTERVALS:
        raise NetworkError(
            f"{name} has {count} intervals of {interval_s:g} s; allowed are {MAX_INTERVALS}: take "
            "longer ones"
        )
    return tuple(
        round(packets[i] * PACKET_BYTES * 8e3 / min(interval_ms, last_ms - i * interval_ms))
        for i in range(count)
    )


def _lines(path: Path) -> Iterator[str]:
    # What is no text either has one bad line, and never a line that fills the memory.
    with open(path, encoding="ascii", errors="replace") as file:
        while line := file.readline(_LONGEST_LINE):
            yield line


def _time(where: str, line: str, number: int, last_ms: int) -> int:
    text = line.strip()
    if number > MAX_LINES:
        raise NetworkError(f"{where}: a trace has at most {MAX_LINES} lines")
    if not (text.isascii() and text.isdigit()) or len(line) >= _LONGEST_LINE:
        raise NetworkError(
            f"{where} is {text!r}; it must be a whole number of milliseconds from 0 to {MAX_MS}"
        )
    time_ms = int(text)
    if time_ms > MAX_MS:
        raise NetworkError(f"{where} is {time_ms}; a trace may last {MAX_MS} ms")
    if time_ms < last_ms:
        raise NetworkError(f"{where} is {time_ms}, after {last_ms}: times must not go back")
    return time_ms
