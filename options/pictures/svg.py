"""A picture as SVG: one path a layer."""

from __future__ import annotations

from xml.sax.saxutils import escape

import numpy as np

from options.pictures.picture import Dots, Filled, Layer, Picture, Places, Rings


def to_svg(picture: Picture) -> str:
    """The document; the same picture gives the same bytes."""
    wide, high = picture.wide, picture.high + picture.text_high
    left, top = -picture.wide / 2, -picture.high / 2
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" '
        f'viewBox="{left:g} {top:g} {wide} {high}">'
    )
    back = f'<rect x="{left:g}" y="{top:g}" width="{wide}" height="{high}" fill="white"/>'
    parts = [head, back, *(_layer(layer) for layer in picture.layers)]
    if picture.words.parts:
        runs = "".join(
            f'<tspan fill="{color}">{escape(text)}</tspan>' if color else escape(text)
            for text, color in picture.words.parts
        )
        line = picture.high / 2 + 42
        parts.append(f'<text x="{left + 12:g}" y="{line:g}" font-size="32">{runs}</text>')
    return "\n".join([*parts, "</svg>\n"])


def _layer(layer: Layer) -> str:
    if isinstance(layer, Dots):
        steps = np.diff(layer.places, axis=0, prepend=np.zeros((1, 2), dtype=np.int64))
        path = "".join(f"m{x} {y}h0" for x, y in steps.tolist())
        return (
            f'<path d="{path}" fill="none" stroke="{layer.color}" stroke-width="4" '
            f'stroke-linecap="round" opacity="0.5"/>'
        )
    if isinstance(layer, Filled):
        return f'<path d="{_run(layer.corners)}z" fill="{layer.color}"/>'
    if isinstance(layer, Rings):
        r = layer.radius
        path = "".join(
            f"M{x - r:.1f} {y:.1f}a{r:g} {r:g} 0 1 0 {2 * r:g} 0a{r:g} {r:g} 0 1 0 {-2 * r:g} 0z"
            for x, y in layer.middles.tolist()
        )
    else:
        path = "".join(f"{_run(corners)}z" for corners in layer.closed)
        path += "".join(_run(corners) for corners in layer.open)
    return f'<path d="{path}" fill="none" stroke="{layer.color}" stroke-width="{layer.width:g}"/>'


def _run(corners: Places) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners.tolist())
