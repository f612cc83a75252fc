"""A shape as it is in the kernel beside one as it should be."""

from __future__ import annotations

from collections.abc import Iterator

from network_controller.model import ClassShape, LinkReading, LinkShape

_TOLERANCE = 0.01
"""`tc` prints rates rounded."""


def differences(have: LinkReading, wanted: LinkShape) -> Iterator[str]:
    """What a reading has otherwise than a shape."""
    pairs = [
        ("the capacity in bit/s", have.capacity_bps, wanted.capacity_bps),
        ("the medium's capacity in bit/s", have.cell_bps, wanted.cell_bps),
        ("the delay in ms", have.delay_ms, wanted.delay_ms),
        ("the loss in %", 100 * have.loss, 100 * wanted.loss),
    ]
    for traffic, should in wanted.classes.items():
        has, name = have.classes[traffic].shape, traffic.name.lower()
        pairs += [
            (f"{name}'s rate in bit/s", has.rate_bps, should.rate_bps),
            (f"{name}'s ceiling in bit/s", has.ceil_bps, should.ceil_bps),
        ]
        if has.priority != should.priority:
            yield f"{name}'s priority is {has.priority}, not {should.priority}"
    for what, is_now, should_be in pairs:
        slack = 8.0 if what.endswith("bit/s") else 0.01
        if abs(is_now - should_be) > max(slack, _TOLERANCE * should_be):
            yield f"{what} is {is_now:g}, not {should_be:g}"


def shape_of(reading: LinkReading) -> LinkShape:
    """The shape that a reading shows."""
    classes = {
        traffic: ClassShape(one.shape.rate_bps, one.shape.ceil_bps, one.shape.priority)
        for traffic, one in reading.classes.items()
    }
    return LinkShape(
        reading.capacity_bps, classes, reading.delay_ms, reading.loss, reading.cell_bps
    )
