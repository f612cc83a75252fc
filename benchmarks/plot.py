"""Draws a line chart as SVG, without a plotting library."""

from __future__ import annotations

WIDTH, HEIGHT = 640, 400
LEFT, RIGHT, TOP, BOTTOM = 60, 190, 20, 50
COLORS = ("#1b6ca8", "#d1495b", "#3a7d44", "#edae49", "#7b4b94", "#444444", "#00798c")
TICKS = 5

Series = dict[str, list[tuple[float, float]]]


def line_chart(series: Series, across: str, up: str) -> str:
    """An SVG document of named lines (x, y), with both axes from 0."""
    most_x = max(x for points in series.values() for x, _ in points)
    most_y = max(y for points in series.values() for _, y in points) or 1.0

    def place(x: float, y: float) -> tuple[float, float]:
        wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
        return LEFT + x / most_x * wide, HEIGHT - BOTTOM - y / most_y * high

    parts = []
    for tick in range(TICKS + 1):
        x, y = tick / TICKS * most_x, tick / TICKS * most_y
        (px, base), (left, py), (right, _) = place(x, 0), place(0, y), place(most_x, y)
        parts += [
            f'<text x="{px:.1f}" y="{base + 18:.1f}" text-anchor="middle">{x:g}</text>',
            f'<text x="{left - 8:.1f}" y="{py + 4:.1f}" text-anchor="end">{y:.0f}</text>',
            f'<path d="M{left:.1f} {py:.1f}H{right:.1f}" stroke="#ddd"/>',
        ]
    key = WIDTH - RIGHT + 12
    for index, (name, points) in enumerate(series.items()):
        color = COLORS[index % len(COLORS)]
        line = " ".join(f"{px:.1f},{py:.1f}" for px, py in (place(x, y) for x, y in points))
        parts += [
            f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>',
            f'<text x="{key}" y="{TOP + 20 + 20 * index}" fill="{color}">{name}</text>',
        ]
    middle = (LEFT + WIDTH - RIGHT) / 2
    turned = f"translate(16 {HEIGHT / 2}) rotate(-90)"
    parts += [
        f'<text x="{middle}" y="{HEIGHT - 12}" text-anchor="middle">{across}</text>',
        f'<text transform="{turned}" text-anchor="middle">{up}</text>',
    ]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'font-family="sans-serif" font-size="13">'
    )
    back = f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>'
    return "\n".join([head, back, *parts, "</svg>\n"])
