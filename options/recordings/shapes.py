"""What a swarm says, in Foxglove's schemas."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    Duration,
    FrameTransform,
    FrameTransforms,
    Log,
    LogLevel,
    PackedElementField,
    PackedElementFieldNumericType,
    PointCloud,
    PoseInFrame,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    Vector3,
)
from foxglove.messages import Pose as FoxglovePose
from numpy.typing import NDArray

from options.recordings.format import WORLD_FRAME, Box, Track
from swarm.geometry import Points, Pose

FUSED_COLOR = (0.10, 0.65, 0.30)
TRUE_COLOR = (0.35, 0.35, 0.40)
SEEN_OPACITY, REMEMBERED_OPACITY = 0.4, 0.15
OBJECT_COLORS = (
    (0.12, 0.47, 0.71),
    (1.00, 0.50, 0.05),
    (0.58, 0.40, 0.74),
    (0.84, 0.15, 0.16),
    (0.55, 0.34, 0.29),
    (0.09, 0.75, 0.81),
)
"""Robots take turns; told apart also with the usual colour blindnesses, and by their topics."""
_FLOAT32 = PackedElementFieldNumericType.Float32
_NS = 1_000_000_000
LATEST_NS = 2**32 * _NS - 1
"""The last moment that Foxglove's timestamps can name, in the year 2106."""
_LABEL_GAP_M = 0.3
SHOWN_S = 3
"""Seconds after which what nobody has said again is no longer shown."""
LEVELS = {"info": LogLevel.Info, "warning": LogLevel.Warning, "error": LogLevel.Error}


def timestamp(time_ns: int) -> Timestamp:
    """A time as Foxglove writes it."""
    return Timestamp(time_ns // _NS, time_ns % _NS)


def quaternion(pose: Pose) -> Quaternion:
    """The rotation of a pose, R = Rz(yaw) Ry(pitch) Rx(roll), as a unit quaternion."""
    cr, sr = math.cos(pose.roll / 2), math.sin(pose.roll / 2)
    cp, sp = math.cos(pose.pitch / 2), math.sin(pose.pitch / 2)
    cy, sy = math.cos(pose.yaw / 2), math.sin(pose.yaw / 2)
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def cloud(robot: str, points: Points, time_ns: int) -> PointCloud:
    """A scan, float32 (N, 3), in the frame of the robot's sensor, which has the robot's name."""
    return PointCloud(
        timestamp=timestamp(time_ns),
        frame_id=robot,
        pose=FoxglovePose(position=Vector3(), orientation=Quaternion(w=1.0)),
        point_stride=12,
        fields=[
            PackedElementField(name=name, offset=4 * place, type=_FLOAT32)
            for place, name in enumerate("xyz")
        ],
        data=np.ascontiguousarray(points, dtype="<f4").tobytes(),
    )


def transforms(poses: dict[str, Pose], time_ns: int) -> FrameTransforms:
    """Where sensors are in the world."""
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=timestamp(time_ns),
                parent_frame_id=WORLD_FRAME,
                child_frame_id=robot,
                translation=Vector3(x=pose.x, y=pose.y, z=pose.z),
                rotation=quaternion(pose),
            )
            for robot, pose in poses.items()
        ]
    )


def pose_in_world(pose: Pose, time_ns: int) -> PoseInFrame:
    """Where a sensor is."""
    return PoseInFrame(
        timestamp=timestamp(time_ns),
        frame_id=WORLD_FRAME,
        pose=FoxglovePose(
            position=Vector3(x=pose.x, y=pose.y, z=pose.z), orientation=quaternion(pose)
        ),
    )


def boxes(
    found: Sequence[Box], time_ns: int, color: tuple[float, float, float], opacity: float
) -> SceneUpdate:
    """Boxes with their labels, in place of those before."""
    return _scene(
        time_ns,
        [_cube(box.center, box.size, box.heading, color, opacity) for box in found],
        [
            _text(
                f"{box.label} {box.score:.2f}" if box.score < 1 else box.label,
                box.center,
                box.size[2] / 2 + _LABEL_GAP_M,
                color,
            )
            for box in found
        ],
    )


def tracks(found: Sequence[Track], gone: Iterable[int], time_ns: int) -> SceneUpdate:
    """Remembered objects, an entity each under its id, fainter where nobody has seen it in this
    frame; `gone` are ids that are remembered no more."""
    return SceneUpdate(
        deletions=[
            SceneEntityDeletion(
                timestamp=timestamp(time_ns), type=SceneEntityDeletionType.MatchingId, id=str(one)
            )
            for one in sorted(gone)
        ],
        entities=[_track(one, time_ns) for one in found],
    )


def objects(
    table: NDArray[np.float32], time_ns: int, color: tuple[float, float, float]
) -> SceneUpdate:
    """The objects of a scene description, float32 (N, 9) as in `messages.SceneDescription`."""
    return _scene(
        time_ns,
        [
            _cube(tuple(row[:3]), tuple(row[4:7]), 0.0, color, 0.3)
            for row in table.astype(np.float64).tolist()
        ],
        [],
    )


def log(text: str, level: str, name: str, time_ns: int) -> Log:
    """One line; `level` is one of LEVELS."""
    return Log(timestamp=timestamp(time_ns), level=LEVELS[level], message=text, name=name)


def _track(one: Track, time_ns: int) -> SceneEntity:
    opacity = REMEMBERED_OPACITY if one.age_s > 0 else SEEN_OPACITY
    text = f"{one.label} {one.id} {math.hypot(*one.velocity):.1f} m/s"
    # Below, for the label of the frame's own box stands above.
    below = -one.size[2] / 2 - _LABEL_GAP_M
    return _entity(
        str(one.id),
        time_ns,
        [_cube(one.center, one.size, one.heading, FUSED_COLOR, opacity)],
        [_text(text, one.center, below, FUSED_COLOR)],
    )


def _scene(time_ns: int, cubes: list[CubePrimitive], texts: list[TextPrimitive]) -> SceneUpdate:
    if cubes:
        return SceneUpdate(entities=[_entity("all", time_ns, cubes, texts)])
    # An entity without primitives would leave the ones before where they are.
    gone = SceneEntityDeletion(timestamp=timestamp(time_ns), type=SceneEntityDeletionType.All)
    return SceneUpdate(deletions=[gone])


def _entity(
    name: str, time_ns: int, cubes: list[CubePrimitive], texts: list[TextPrimitive]
) -> SceneEntity:
    return SceneEntity(
        timestamp=timestamp(time_ns),
        frame_id=WORLD_FRAME,
        id=name,
        lifetime=Duration(SHOWN_S),
        cubes=cubes,
        texts=texts,
    )


def _text(
    text: str, center: Sequence[float], above_m: float, color: tuple[float, float, float]
) -> TextPrimitive:
    x, y, z = center
    return TextPrimitive(
        pose=FoxglovePose(position=Vector3(x=x, y=y, z=z + above_m), orientation=Quaternion(w=1.0)),
        billboard=True,
        font_size=12.0,
        scale_invariant=True,
        color=_color(color, 1.0),
        text=text,
    )


def _cube(
    center: Sequence[float],
    size: Sequence[float],
    heading: float,
    color: tuple[float, float, float],
    opacity: float,
) -> CubePrimitive:
    x, y, z = center
    length, width, height = size
    return CubePrimitive(
        pose=FoxglovePose(
            position=Vector3(x=x, y=y, z=z), orientation=quaternion(Pose(0, 0, 0, yaw=heading))
        ),
        size=Vector3(x=length, y=width, z=height),
        color=_color(color, opacity),
    )


def _color(color: tuple[float, float, float], opacity: float) -> Color:
    red, green, blue = color
    return Color(r=red, g=green, b=blue, a=opacity)
