"""The ROS 2 messages in which fused objects leave, encoded in CDR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from options.ros.writer import NS, Writer

FRAME = "map"
"""The world frame's name, by REP-105."""
LIFETIME_S = 3
"""Markers that nobody has drawn again for so long vanish: the swarm is gone."""
SEEN, UNSEEN = 0, -1
"""In the grid: free ground that somebody sees, and what is not known."""

_COVARIANCE = (0.0,) * 36
_ARROW, _CUBE, _TEXT = 0, 1, 9
_ADD, _DELETE_ALL = 0, 3
_MOVING_M_S = 0.1
_REMEMBERED = 0.5
"""How solid a marker is of what was seen before and not in this frame."""
_COLORS = {
    "person": (0.84, 0.15, 0.16),
    "robot": (0.12, 0.47, 0.71),
    "forklift": (1.0, 0.5, 0.05),
}
_OTHER_COLOR = (0.10, 0.65, 0.30)


@dataclass(frozen=True, slots=True)
class Object:
    """What is there, in the world frame."""

    id: str
    """The same object has the same one in every message; empty where nobody follows it."""
    label: str
    center: tuple[float, float, float]
    """Metres."""
    size: tuple[float, float, float]
    """Length, width, height; metres."""
    heading: float
    """Radians about z."""
    score: float
    """The chance that it is there."""
    velocity: tuple[float, float] = (0.0, 0.0)
    """Along x and y, m/s."""
    age_s: float = 0.0
    """Since anybody has seen it."""


def detections(found: Sequence[Object], stamp_ns: int) -> bytes:
    """A `vision_msgs/Detection3DArray`. No covariance is told: it is 0 throughout."""
    out = Writer().header(stamp_ns, FRAME).put("I", len(found))
    for one in found:
        out.header(stamp_ns, FRAME).put("I", 1)
        out.text(one.label).put("d", one.score)
        out.pose(one.center, one.heading).put("d", *_COVARIANCE)
        out.pose(one.center, one.heading).put("d", *one.size).text(one.id)
    return out.message()


def markers(found: Sequence[Object], stamp_ns: int) -> bytes:
    """A `visualization_msgs/MarkerArray` in place of the one before: of each object a cube, its
    label, and where it moves an arrow to where it will be in one second."""
    moving = [one for one in found if np.hypot(*one.velocity) >= _MOVING_M_S]
    out = Writer().put("I", 1 + 2 * len(found) + len(moving))
    _marker(out, stamp_ns, "", 0, 0, _DELETE_ALL)
    for number, one in enumerate(found):
        solid = 0.7 * (_REMEMBERED if one.age_s > 0 else 1.0)
        color = (*_COLORS.get(one.label, _OTHER_COLOR), solid)
        _marker(out, stamp_ns, "objects", number, _CUBE, one=one, scale=one.size, color=color)
        text = f"{one.label} {one.id} {one.score:.2f}".replace("  ", " ")
        scale = (0.0, 0.0, 0.4)
        _marker(out, stamp_ns, "labels", number, _TEXT, one=one, scale=scale, text=text)
    for number, one in enumerate(moving):
        x, y, z = one.center
        ahead = (x + one.velocity[0], y + one.velocity[1], z)
        scale = (0.1, 0.2, 0.2)
        ends = (one.center, ahead)
        _marker(out, stamp_ns, "velocities", number, _ARROW, scale=scale, points=ends)
    return out.message()


def grid(
    seen: NDArray[np.bool_], corner: tuple[float, float], resolution_m: float, stamp_ns: int
) -> bytes:
    """A `nav_msgs/OccupancyGrid`: SEEN where free ground is seen, UNSEEN elsewhere.

    seen: bool (rows, columns), row 0 at the lowest y. corner: x and y of the first cell's outer
    corner, metres.
    """
    rows, columns = seen.shape
    out = Writer().header(stamp_ns, FRAME)
    out.put("i", stamp_ns // NS).put("I", stamp_ns % NS)
    out.put("f", resolution_m).put("I", columns, rows).pose((*corner, 0.0), 0.0)
    return out.octets(np.where(seen, SEEN, UNSEEN).astype(np.int8).tobytes()).message()


_NOWHERE = Object("", "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)


def _marker(
    out: Writer,
    stamp_ns: int,
    space: str,
    number: int,
    kind: int,
    action: int = _ADD,
    *,
    one: Object = _NOWHERE,
    scale: tuple[float, ...] = (0.0, 0.0, 0.0),
    color: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
    points: Sequence[tuple[float, ...]] = (),
    text: str = "",
) -> None:
    """One `visualization_msgs/Marker`; `space` and `number` together name it."""
    out.header(stamp_ns, FRAME).text(space).put("i", number, kind, action)
    out.pose(one.center, one.heading).put("d", *scale).put("f", *color)
    out.put("i", LIFETIME_S).put("I", 0).put("B", 0)
    out.put("I", len(points))
    for point in points:
        out.put("d", *point)
    out.put("I", 0).text("")
    # The texture: an image without a header, a format or data.
    out.header(0, "").text("").octets(b"")
    out.put("I", 0).text(text).text("").text("").octets(b"").put("B", 0)
