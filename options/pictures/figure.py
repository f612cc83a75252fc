"""A picture as PNG or PDF, drawn by Matplotlib (the extra `figures`)."""

from __future__ import annotations

import io
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from options.pictures.picture import Dots, Filled, Layer, Lines, Picture, Rings

DPI = 100
POINTS_A_PIXEL = 72 / DPI
SCALE = 0.5
"""Of a picture's pixels: a PNG is as many pixels wide as screens are."""


def to_figure(picture: Picture, kind: Literal["png", "pdf"]) -> bytes:
    """The file's bytes."""
    wide, high = picture.wide, picture.high + picture.text_high
    figure = Figure(figsize=(SCALE * wide / DPI, SCALE * high / DPI), dpi=DPI, facecolor="white")
    measured = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(-wide / 2, wide / 2)
    axes.set_ylim(high - picture.high / 2, -picture.high / 2)
    for order, layer in enumerate(picture.layers):
        _draw(axes, layer, order)
    at = 12.0
    for text, color in picture.words.parts:
        place = (at - wide / 2, picture.high / 2 + 42)
        said = axes.annotate(text, place, color=color or "black", fontsize=32 * _ink(1.0))
        at += said.get_window_extent(measured).width / SCALE
    out = io.BytesIO()
    # Without its date the same picture gives the same bytes.
    dated = {"CreationDate": None} if kind == "pdf" else {"Software": None}
    figure.savefig(out, format=kind, metadata=dated)
    return out.getvalue()


def _draw(axes: Axes, layer: Layer, order: int) -> None:
    if isinstance(layer, Dots):
        x, y = layer.places.T
        size = _ink(4.0) ** 2
        axes.scatter(x, y, s=size, c=layer.color, alpha=0.5, linewidths=0, zorder=order)
    elif isinstance(layer, Filled):
        axes.add_patch(Polygon(layer.corners.tolist(), facecolor=layer.color, zorder=order))
    elif isinstance(layer, Rings):
        across = [2 * layer.radius] * len(layer.middles)
        axes.add_collection(
            EllipseCollection(
                across,
                across,
                [0.0] * len(across),
                units="xy",
                offsets=layer.middles,
                offset_transform=axes.transData,
                facecolors="none",
                edgecolors=layer.color,
                linewidths=_ink(layer.width),
                zorder=order,
            )
        )
    elif isinstance(layer, Lines):
        closed = [[*corners.tolist(), corners[0].tolist()] for corners in layer.closed]
        runs = [*closed, *(corners.tolist() for corners in layer.open)]
        axes.add_collection(
            LineCollection(runs, colors=layer.color, linewidths=_ink(layer.width), zorder=order)
        )


def _ink(pixels: float) -> float:
    """In typographic points."""
    return SCALE * pixels * POINTS_A_PIXEL
