"""Links for people: what operators made of them, and what they carry."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from deploy.rates import format_rate
from swarm.controllers import merged, of
from swarm.messages import LinkState, ShapeInForce, ShapeReply


def render(replies: Mapping[str, ShapeReply], links: Sequence[LinkState], now_ns: int) -> str:
    """The shapes in force, the links' state where it is known, and what each controller notes."""
    reply = merged(replies)
    lines = [_shape(shape, now_ns) for shape in reply.shapes] or ["no link is shaped"]
    lines += [f"telemetry runs towards {', '.join(reply.congested)}"] if reply.congested else []
    for link in links:
        lines += ["", *_link(link)]
    lines += [f"note: {note}" for note in reply.notes]
    lines += [f"{of(name)}revision {each.revision}" for name, each in replies.items()]
    return "\n".join(lines)


def _shape(shape: ShapeInForce, now_ns: int) -> str:
    rate = format_rate(shape.rate_bps) if shape.rate_bps else "the link is not there"
    kind = "" if shape.profile == "rate" else f" ({shape.profile})"
    extra = f", delay {shape.delay_ms:g} ms" if shape.delay_ms else ""
    extra += f", loss {100 * shape.loss:g} %" if shape.loss else ""
    left_s = max(0.0, (shape.until_ns - now_ns) / 1e9)
    until = f" until {_clock(shape.until_ns)} ({left_s:.0f} s left)" if shape.until_ns else ""
    return (
        f"{shape.robot} {shape.direction}: {rate}{kind}{extra}{until}, "
        f"by {shape.operator} since {_clock(shape.since_ns)}"
    )


def _clock(ns: int) -> str:
    return time.strftime("%H:%M:%S", time.localtime(ns / 1e9))


def _link(link: LinkState) -> list[str]:
    head = (
        f"{link.robot} {link.direction}: capacity {format_rate(link.capacity_bps)}, "
        f"{format_rate(link.available_bps)} for fusion, latency {link.latency_ms:.0f} ms, "
        f"level {link.level}"
    )
    rows = [("class", "guaranteed", "priority", "now", "waiting", "drops")]
    rows += [
        (
            name,
            format_rate(one.rate_bps),
            str(one.priority),
            format_rate(one.throughput_bps),
            f"{one.backlog_bytes:,} B",
            f"{one.drops:,}",
        )
        for name, one in link.classes.items()
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [head] + [
        "  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
