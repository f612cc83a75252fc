"""Bags for tests, written by the `rosbags` package: an implementation that is not the project's."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from swarm.geometry import Pose

STORE = get_typestore(Stores.ROS2_HUMBLE)
CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
START_NS = 1_700_000_000_000_000_000
LATENCY_NS = 7_000_000
"""From a stamp to the recording of its message."""

_T = STORE.types


def ns(seconds: float) -> int:
    """A stamp, that many seconds after the start of all test bags."""
    return START_NS + round(seconds * 1e9)


def header(stamp_ns: int, frame: str) -> Any:
    time = _T["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return _T["std_msgs/msg/Header"](time, frame)


def cloud(
    stamp_ns: int,
    points: NDArray[Any],
    frame: str = "lidar",
    *,
    layout: str = "<f4",
    order: str = "xyz",
    gap: int = 4,
    row_gap: int = 0,
    rows: int = 1,
) -> Any:
    """A PointCloud2 with `gap` bytes before the coordinates and an intensity after them."""
    kind = np.dtype(layout)
    offsets = [gap + i * kind.itemsize for i in range(3)]
    step = gap + 3 * kind.itemsize + 4
    record = np.dtype(
        {
            "names": list(order),
            "formats": [kind] * 3,
            "offsets": offsets,
            "itemsize": step,
        }
    )
    table = np.zeros(len(points), dtype=record)
    for name in order:
        table[name] = points[:, "xyz".index(name)]
    width = len(points) // rows
    packed = table.tobytes()
    row = width * step
    data = b"".join(packed[i * row : (i + 1) * row] + b"\xee" * row_gap for i in range(rows))
    make = _T["sensor_msgs/msg/PointField"]
    datatype = {4: 7, 8: 8}[kind.itemsize]
    fields = [make(name, offset, datatype, 1) for name, offset in zip(order, offsets, strict=True)]
    fields.append(make("intensity", step - 4, 7, 1))
    return _T[CLOUD](
        header(stamp_ns, frame),
        rows,
        width,
        fields,
        layout.startswith(">"),
        step,
        row + row_gap,
        np.frombuffer(data, dtype=np.uint8),
        False,
    )


def quaternion(pose: Pose) -> Any:
    """Of Rz(yaw) Ry(pitch) Rx(roll), by half angles."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(angle / 2), math.sin(angle / 2)) for angle in (pose.roll, pose.pitch, pose.yaw)
    )
    return _T["geometry_msgs/msg/Quaternion"](
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def odometry(
    stamp_ns: int,
    pose: Pose,
    linear: tuple[float, float, float] = (0, 0, 0),
    angular: tuple[float, float, float] = (0, 0, 0),
    *,
    frame: str = "odom",
    child: str = "base_link",
) -> Any:
    vector, covariance = _T["geometry_msgs/msg/Vector3"], np.zeros(36)
    place = _T["geometry_msgs/msg/Pose"](
        _T["geometry_msgs/msg/Point"](pose.x, pose.y, pose.z), quaternion(pose)
    )
    twist = _T["geometry_msgs/msg/Twist"](vector(*linear), vector(*angular))
    return _T[ODOMETRY](
        header(stamp_ns, frame),
        child,
        _T["geometry_msgs/msg/PoseWithCovariance"](place, covariance),
        _T["geometry_msgs/msg/TwistWithCovariance"](twist, covariance),
    )


def transforms(stamp_ns: int, edges: dict[tuple[str, str], Pose]) -> Any:
    """A TFMessage of (parent, child) -> pose of the child in the parent."""
    make = _T["geometry_msgs/msg/Transform"]
    return _T[TRANSFORMS](
        [
            _T["geometry_msgs/msg/TransformStamped"](
                header(stamp_ns, parent),
                child,
                make(_T["geometry_msgs/msg/Vector3"](pose.x, pose.y, pose.z), quaternion(pose)),
            )
            for (parent, child), pose in edges.items()
        ]
    )


@dataclass
class Log:
    """Messages to be written: (topic, type, when recorded, message)."""

    rows: list[tuple[str, str, int, Any]] = field(default_factory=list)

    def add(self, topic: str, kind: str, stamp_ns: int, message: Any) -> Log:
        self.rows.append((topic, kind, stamp_ns + LATENCY_NS, message))
        return self

    def scans(
        self,
        times_s: Iterable[float],
        points: NDArray[Any] | None = None,
        *,
        topic: str = "/points",
        frame: str = "lidar",
    ) -> Log:
        """Scans whose first point says when they were taken."""
        for time in times_s:
            its = np.array([[time, 1, 1]]) if points is None else points
            self.add(topic, CLOUD, ns(time), cloud(ns(time), its, frame))
        return self

    def drive(
        self, times_s: Iterable[float], speed: float = 1.0, *, topic: str = "/odom", **names: Any
    ) -> Log:
        """Odometry along x at a steady speed, 0 at time 0."""
        for time in times_s:
            pose = Pose(speed * time, 0, 0)
            message = odometry(ns(time), pose, (speed, 0, 0), **names)
            self.add(topic, ODOMETRY, ns(time), message)
        return self

    def tf(self, time_s: float, edges: dict[tuple[str, str], Pose], static: bool = False) -> Log:
        topic = "/tf_static" if static else "/tf"
        return self.add(topic, TRANSFORMS, ns(time_s), transforms(ns(time_s), edges))

    def write(
        self, path: Path, storage: str = "mcap", compress: str = "", order: str = "little"
    ) -> Path:
        """Writes a rosbag2 directory. `compress`: message, file or storage."""
        plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[storage]
        writer = Writer(path, version=9, storage_plugin=plugin)
        if compress:
            writer.set_compression(CompressionMode[compress.upper()], CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for topic, kind, recorded_ns, message in sorted(self.rows, key=lambda row: row[2]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                raw = STORE.serialize_cdr(message, kind, little_endian=order == "little")
                writer.write(connections[topic], recorded_ns, raw)
        return path


MOUNT = {("base_link", "lidar"): Pose(0.2, 0, 1.2)}


def plain_log(times_s: Iterable[float], speed: float = 1.0) -> Log:
    """Scans and odometry at the same times, and the sensor's mount."""
    times = list(times_s)
    return Log().scans(times).drive(times, speed).tf(times[0], MOUNT, static=True)
