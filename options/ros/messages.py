"""The three ROS 2 messages that a world needs, decoded from CDR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from options.ros.cdr import CdrError, Cursor
from swarm.geometry import Points

CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

STAMP_BYTES = 12
"""Of a message that starts with a header: enough to read its stamp."""
_FLOATS = {7: "f4", 8: "f8"}
"""`PointField.datatype` of coordinates that can be read: FLOAT32 and FLOAT64."""
_LEAST_FIELD_BYTES = 16
_LEAST_TRANSFORM_BYTES = 72

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Transform:
    """`child` in `parent` at a moment."""

    stamp_ns: int
    parent: str
    child: str
    translation: Vector
    """x, y, z in metres."""
    rotation: Vector
    """A quaternion x, y, z, w."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """A robot's own estimate."""

    transform: Transform
    linear: Vector
    """m/s in the child frame."""
    angular: Vector
    """rad/s in the child frame."""


@dataclass(frozen=True, slots=True)
class Cloud:
    """One scan."""

    stamp_ns: int
    frame: str
    points: Points
    """float32 (N, 3), metres, in `frame`; read-only. Without missing returns."""


def read_stamp(head: bytes | memoryview) -> int:
    """The header's stamp, nanoseconds, of a message's first `STAMP_BYTES`."""
    return Cursor(head).stamp()


def read_frame(message: bytes | memoryview) -> str:
    """The header's frame."""
    cursor = Cursor(message)
    cursor.stamp()
    return _frame(cursor.text())


def read_odometry(message: bytes | memoryview) -> Odometry:
    """A `nav_msgs/Odometry`. Raises CdrError for a malformed one."""
    cursor = Cursor(message)
    stamp, parent, child = cursor.stamp(), cursor.text(), cursor.text()
    pose = cursor.doubles(7)
    cursor.doubles(36)
    twist = cursor.doubles(6)
    transform = Transform(stamp, _frame(parent), _frame(child), pose[:3], pose[3:])
    return Odometry(transform, twist[:3], twist[3:])


def read_transforms(message: bytes | memoryview) -> list[Transform]:
    """A `tf2_msgs/TFMessage`. Raises CdrError for a malformed one."""
    cursor = Cursor(message)
    found = []
    for _ in range(cursor.count(_LEAST_TRANSFORM_BYTES)):
        stamp, parent, child = cursor.stamp(), cursor.text(), cursor.text()
        pose = cursor.doubles(7)
        found.append(Transform(stamp, _frame(parent), _frame(child), pose[:3], pose[3:]))
    return found


def read_cloud(message: bytes | memoryview) -> Cloud:
    """A `sensor_msgs/PointCloud2` with float32 or float64 x, y, z in any order, place and byte
    order. Raises CdrError for another one.

    A missing return is a point that is not finite, or lies at the very origin of the sensor.
    """
    cursor = Cursor(message)
    stamp, frame = cursor.stamp(), _frame(cursor.text())
    height, width = cursor.whole("I"), cursor.whole("I")
    fields: dict[str, tuple[int, int, int]] = {}
    for _ in range(cursor.count(_LEAST_FIELD_BYTES)):
        name = cursor.text()
        fields[name] = cursor.whole("I"), cursor.whole("B"), cursor.whole("I")
    order = ">" if cursor.whole("B") else "<"
    point_step, row_step = cursor.whole("I"), cursor.whole("I")
    data = cursor.octets()
    count = height * width
    if not count:
        return Cloud(stamp, frame, _read_only(np.zeros((0, 3), dtype=np.float32)))
    codes = [_float_at(fields, name, point_step) for name in "xyz"]
    if height == 1:
        row_step = width * point_step
    needed = (height - 1) * row_step + width * point_step
    if needed > len(data) or row_step < width * point_step:
        raise CdrError(
            f"{height} rows of {width} points of {point_step} bytes, a row every {row_step} bytes, "
            f"do not fit its {len(data)} bytes of data"
        )
    points = np.empty((count, 3), dtype=np.float32)
    rows = points.reshape(height, width, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        for column, (name, code) in enumerate(zip("xyz", codes, strict=True)):
            # A view of the message: the one copy is into the points.
            view: np.ndarray[tuple[int, int], np.dtype[np.floating]] = np.ndarray(
                (height, width), order + code, data, fields[name][0], (row_step, point_step)
            )
            rows[:, :, column] = view
        there = np.isfinite(points).all(axis=1) & points.any(axis=1)
    return Cloud(stamp, frame, _read_only(points if there.all() else points[there]))


def _float_at(fields: dict[str, tuple[int, int, int]], name: str, point_step: int) -> str:
    """The NumPy type of a coordinate, checked to lie within a point."""
    if name not in fields:
        raise CdrError(f"it has no field {name!r}; it has {', '.join(sorted(fields)) or 'none'}")
    offset, datatype, count = fields[name]
    if datatype not in _FLOATS:
        raise CdrError(
            f"its field {name!r} has datatype {datatype}; allowed: 7 (float32) and 8 (float64)"
        )
    code = _FLOATS[datatype]
    if count > 1 or offset + int(code[1]) > point_step:
        raise CdrError(
            f"its field {name!r} ({count} numbers at byte {offset}) does not fit a point of "
            f"{point_step} bytes"
        )
    return code


def _frame(name: str) -> str:
    """Frames of old drivers begin with a slash that means nothing."""
    return name.lstrip("/")


def _read_only(points: Points) -> Points:
    points.setflags(write=False)
    return points
