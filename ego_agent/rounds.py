"""What one fusion round shows of the links: of the cell that all share, and of each robot's own.

An answer's bytes are on their way from the moment its robot had encoded them to their arrival. The
cell's rate is the largest of the rates at which the first answer, the first two ... came in: bytes
by the time in which anything was on its way. A straggler at the end therefore takes nothing from
what the others have shown. Where those others were so quick that they did not fill the cell, and
the straggler's tail is much slower than they were, the tail is the straggler's own doing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

LATENCY_S = 0.05
"""What is over within this time shows latency, not capacity."""
MIN_FILL_BYTES = 5_000
"""Fewer bytes cannot fill a link: when the boxes of six robots take long, a busy machine is late,
and to send even less would help nobody."""
BUCKET_S = 0.02
"""A shaper lets what it would send in this time pass at once: the depth of the network
controller's buckets."""
OUTPACED = 1.5
"""This many times faster is evidence, less may be an uneven share of one link."""
QUICK_SHARE = 1.0 / 3.0
"""Share of a round's bytes that must have come quickly to say something about the others."""
FLOOR_BPS = 50_000.0
"""No estimate is lower, so that a link that comes back can be found again."""
_MIN_SPAN_S = 0.001


@dataclass(frozen=True, slots=True)
class Transfer:
    """One answer on its way: times are `time.monotonic()` seconds."""

    robot: str
    wire_bytes: int
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Sample:
    """What a round shows of one link."""

    size: int
    """Bytes that came over it."""
    rate_bps: float
    """What it carried while it was filled; where it was not: what it carries at least."""
    filled: bool
    """The link was the limit."""


@dataclass(frozen=True, slots=True)
class Round:
    """One round as the links saw it."""

    cell: Sample
    robots: Mapping[str, Sample] = field(default_factory=dict)
    """No sample is `filled` where a robot was alone: its link and the cell look the same."""
    sole: str | None = None
    """The only robot that sent anything."""


def busy_s(intervals: Iterable[tuple[float, float]]) -> float:
    """Seconds that lie in at least one of the intervals (start, end)."""
    return sum(end - start for start, end in _united(intervals))


def measure(transfers: Iterable[Transfer], begun_s: float) -> Round | None:
    """What the answers since `begun_s` show; None where there is none. Of an answer that was on its
    way already only the share after `begun_s` counts."""
    parts = sorted(
        (_since(t, begun_s) for t in transfers if t.end_s > begun_s and t.wire_bytes > 0),
        key=lambda t: t.end_s,
    )
    if not parts:
        return None
    cell = _cell(parts)
    sole = parts[0].robot if len({part.robot for part in parts}) == 1 else None
    samples: dict[str, Sample] = {}
    for part in parts:
        samples[part.robot] = _own(part, parts, cell, alone=sole is not None)
    return Round(cell, samples, sole)


def _cell(parts: Sequence[Transfer]) -> Sample:
    """`parts` in the order of arrival."""
    total = sum(part.wire_bytes for part in parts)
    spans = _united((part.start_s, part.end_s) for part in parts)
    filled_bps, quick_bps, arrived = 0.0, FLOOR_BPS, 0
    for part in parts:
        arrived += part.wire_bytes
        busy = sum(max(0.0, min(end, part.end_s) - start) for start, end in spans)
        if busy >= LATENCY_S and arrived >= MIN_FILL_BYTES:
            filled_bps = max(filled_bps, _rate(arrived, busy))
        elif arrived >= total * QUICK_SHARE:
            quick_bps = max(quick_bps, _at_least(arrived, busy))
    if filled_bps > 0.0 and quick_bps < OUTPACED * filled_bps:
        return Sample(total, filled_bps, filled=True)
    return Sample(total, quick_bps, filled=False)


def _own(part: Transfer, parts: Sequence[Transfer], cell: Sample, *, alone: bool) -> Sample:
    """What a robot's answer shows of its own link: that was the limit where the cell, in the same
    round, did much more than what it carried while this answer was on its way."""
    span = part.end_s - part.start_s
    if span < LATENCY_S or part.wire_bytes < MIN_FILL_BYTES:
        return Sample(part.wire_bytes, _at_least(part.wire_bytes, span), filled=False)
    rate = _rate(part.wire_bytes, span)
    if alone:
        return Sample(part.wire_bytes, rate, filled=False)
    around = sum(other.wire_bytes * _overlap(part, other) for other in parts)
    return Sample(part.wire_bytes, rate, filled=_rate(around, span) * OUTPACED <= cell.rate_bps)


def _rate(size: float, seconds: float) -> float:
    return max(FLOOR_BPS, size * 8.0 / max(seconds, _MIN_SPAN_S))


def _at_least(size: float, seconds: float) -> float:
    """A link that took so little time may have had a full bucket."""
    return _rate(size, seconds + BUCKET_S)


def _since(whole: Transfer, begun_s: float) -> Transfer:
    if whole.start_s >= begun_s:
        return whole
    share = (whole.end_s - begun_s) / (whole.end_s - whole.start_s)
    return Transfer(whole.robot, max(1, round(whole.wire_bytes * share)), begun_s, whole.end_s)


def _overlap(one: Transfer, other: Transfer) -> float:
    """Share of the other's time on the link in which the one was on it too."""
    common = min(one.end_s, other.end_s) - max(one.start_s, other.start_s)
    return max(0.0, common) / max(other.end_s - other.start_s, _MIN_SPAN_S)


def _united(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The union of intervals as disjoint ones in order."""
    united: list[tuple[float, float]] = []
    for start, end in sorted(intervals):
        if united and start <= united[-1][1]:
            united[-1] = united[-1][0], max(united[-1][1], end)
        else:
            united.append((start, max(start, end)))
    return united
