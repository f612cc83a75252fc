"""A picture as what is in it, before it is written in any format."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.floating]
"""(N, 2): pixels from the middle, x to the right, y down."""


@dataclass(frozen=True, slots=True)
class Dots:
    """Points of a cloud."""

    places: NDArray[np.int64]
    """(N, 2): whole pixels, each once."""
    color: str


@dataclass(frozen=True, slots=True)
class Lines:
    """Outlines of one ink."""

    closed: tuple[Places, ...]
    """Corners of polygons."""
    open: tuple[Places, ...]
    color: str
    width: float


@dataclass(frozen=True, slots=True)
class Rings:
    """Circles."""

    middles: Places
    radius: float
    color: str
    width: float


@dataclass(frozen=True, slots=True)
class Filled:
    """A polygon without outline."""

    corners: Places
    color: str


@dataclass(frozen=True, slots=True)
class Words:
    """A line of text, in parts of a colour each."""

    parts: tuple[tuple[str, str], ...]
    """(text, colour); without a colour black."""


Layer = Dots | Lines | Rings | Filled


@dataclass(frozen=True, slots=True)
class Picture:
    """Layers, the lowest first, and a line of text under them."""

    wide: int
    high: int
    """Of the area, pixels; the middle is (0, 0)."""
    layers: list[Layer] = field(default_factory=list)
    words: Words = field(default_factory=lambda: Words(()))

    @property
    def text_high(self) -> int:
        """Of the stripe for the text, pixels; none without text."""
        return 60 if self.words.parts else 0
