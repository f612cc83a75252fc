"""Pictures from above, for a notebook or as a file."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coadapt.api.cloud import ScanLike, as_cloud
from coadapt.api.fusing import Fused
from perception.types import Boxes
from swarm.geometry import Points
from worlds.cooperative.judging import EVALUATION_RANGES_M

if TYPE_CHECKING:
    from options.pictures.picture import Picture

STEP_M = 5.0
FARTHEST_M = 150.0
"""Of a picture's sides; a stray point farther away does not widen it."""


class Drawing:
    """A picture; a notebook shows it."""

    def __init__(self, picture: Picture) -> None:
        self._picture = picture

    def save(self, path: str | Path) -> None:
        """Writes it as PNG, SVG or PDF, by the file's ending (PNG and PDF need Matplotlib, the
        extra `figures`).

        Raises PictureError for another ending, or a directory that is not there: none is made.
        """
        from options.pictures.saving import save

        save(self._picture, Path(path))

    def svg(self) -> str:
        """The SVG document."""
        from options.pictures.svg import to_svg

        return to_svg(self._picture)

    def _repr_svg_(self) -> str:
        return self.svg()

    def __repr__(self) -> str:
        words = "".join(text for text, _ in self._picture.words.parts)
        return f"Drawing({words})"


def draw(
    what: Fused | Boxes | ScanLike, file: str | Path | None = None, *, half_m: float | None = None
) -> Drawing:
    """What was fused, boxes or a scan, from above, ahead to the right; the ego is a triangle.

    Args:
        what: its points without ground, a colour a robot, and boxes with a line to the front.
        file: written as PNG, SVG or PDF, by its ending; in a directory that is there.
        half_m: how far is shown along x and y; None shows where the detector looks, or all.

    >>> import coadapt
    >>> floor = coadapt.world("factory", robots=2, rings=16)
    >>> coadapt.draw(coadapt.scan(floor.scan("R1", 0)), half_m=20)
    Drawing(1 scan, 40 x 40 m; points of the ego)

    Raises PictureError for a file that cannot be written, before anything is drawn, and ScanError
    for what is no scan.
    """
    from options.pictures.above import (
        FOUND,
        OTHERS,
        TRUE,
        Outlines,
        Said,
        above_ground,
        area_said,
        from_above,
        points_said,
    )
    from options.pictures.saving import check_target

    if file is not None:
        check_target(Path(file))
    clouds: list[Points] = []
    outlines: list[Outlines] = []
    said: list[Said] = []
    half: tuple[float, float] | None = None
    if isinstance(what, Fused):
        clouds = [above_ground(one.points, one.pose) for one in what.clouds]
        half = EVALUATION_RANGES_M[what.detector]
        outlines = [Outlines(what.known, OTHERS[0], 6), Outlines(what.boxes, FOUND, 4)]
        said = points_said(len(clouds))
        if len(clouds) > 1:
            known = f", {len(what.known)} known robot{'s' if len(what.known) > 1 else ''}"
            said.append((known, OTHERS[0]))
        said += [(f", {len(what)} found", FOUND)]
    elif isinstance(what, Boxes):
        outlines = [Outlines(what, TRUE, 4)]
        said = [(f"{len(what)} boxes", TRUE)]
    else:
        clouds = [above_ground(as_cloud(what).points)]
        said = points_said(1)
    if half_m is not None:
        half = (half_m, half_m)
    elif half is None:
        half = _extent([*clouds, *(one.boxes.centers for one in outlines)])
    count = f"{len(clouds)} scan{'s' if len(clouds) > 1 else ''}, " if clouds else ""
    drawing = Drawing(from_above(half, clouds, outlines, [area_said(count, half), *said]))
    if file is not None:
        drawing.save(file)
    return drawing


def _extent(places: Iterable[np.ndarray]) -> tuple[float, float]:
    reach = max((float(np.abs(part[:, :2]).max(initial=0.0)) for part in places), default=0.0)
    half = min(FARTHEST_M, STEP_M * (1 + math.floor(reach / STEP_M)))
    return half, half
