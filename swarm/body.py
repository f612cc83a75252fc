"""The body of a robot: the box that everybody else sees of it."""

from __future__ import annotations

from typing import Annotated

import msgspec

LARGEST_M = 30.0
"""Longer than any truck or crane that carries a sensor."""

Label = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]
Side = Annotated[float, msgspec.Meta(gt=0, le=LARGEST_M)]
Offset = Annotated[float, msgspec.Meta(ge=-LARGEST_M, le=LARGEST_M)]


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """A robot's body as it announces it."""

    label: Label
    """Its class."""
    size: tuple[Side, Side, Side]
    """Length, width, height, metres."""
    center: tuple[Offset, Offset, Offset]
    """The middle of the body in the sensor's frame, metres."""
