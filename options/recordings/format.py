"""What a recording of a swarm holds: topics, and the JSON of those that are read again.

All of it is MCAP: point clouds, boxes, transforms and logs in Foxglove's schemas (protobuf), the
rest as JSON with a schema. Times are nanoseconds since the epoch, positions metres in the world
frame, angles radians, rates bit/s. Everything about one frame is logged at its capture time.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

VERSION = 2
READABLE = (1, 2)
"""In version 1 no scans are ranges."""
WORLD_FRAME = "world"

HEADER = "/recording"
FRAME = "/frame"
RAYS = "/rays"
TRUTH = "/truth"
TRUTH_BOXES = "/truth/boxes"
FUSED = "/ego/detections"
FUSED_BOXES = "/ego/boxes"
TRACKS = "/ego/tracks"
DECISION = "/ego/decision"
BUDGET = "/ego/budget"
LINKS = "/net/links"
TRANSFORMS = "/tf"
LOG = "/log"

Points = Literal["none", "selected", "all"]
Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Count = Annotated[int, msgspec.Meta(ge=0)]


def points_topic(robot: str) -> str:
    """`foxglove.PointCloud`: a robot's scan, in its sensor's frame (named by the robot); for
    viewers some of its points, where the scan is on `ranges_topic`."""
    return f"/robot/{robot}/points"


def ranges_topic(robot: str) -> str:
    """A robot's scan, to the last bit, where the sensor's rays are known."""
    return f"/robot/{robot}/ranges"


def objects_topic(robot: str) -> str:
    """`foxglove.SceneUpdate`: the objects that a robot describes."""
    return f"/robot/{robot}/objects"


def pose_topic(robot: str) -> str:
    """`foxglove.PoseInFrame`: a robot's sensor in the world, from its beacons."""
    return f"/robot/{robot}/pose"


def beacon_topic(robot: str) -> str:
    """A robot's beacons."""
    return f"/robot/{robot}/beacon"


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """What was recorded; the first message. The world's properties are None where scans were not
    recorded."""

    version: int = VERSION
    swarm: str
    ego: str
    robots: tuple[str, ...]
    world: str
    """The world that the swarm ran in."""
    epoch_ns: Count
    """When the swarm's frame 0 was captured."""
    points: Points
    """Whose scans were recorded in a frame: nobody's, of those chosen to take part, everybody's."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0)] | None = None
    range_m: Annotated[float, msgspec.Meta(gt=0)] | None = None
    detector: str | None = None
    comm_range_m: Annotated[float, msgspec.Meta(gt=0)] | None = None
    """How far from the ego a robot could take part; None where it was the ego's own setting."""
    started_ns: Count


class SensorRays(msgspec.Struct, frozen=True, kw_only=True):
    """The rays of every robot's sensor; before the first scan."""

    rings: Annotated[int, msgspec.Meta(ge=1)]
    columns: Annotated[int, msgspec.Meta(ge=1)]
    step_m: Annotated[float, msgspec.Meta(gt=0)]
    """Ranges are whole multiples of it."""
    directions: bytes
    """zlib of float32 (rings, columns, 3), little endian: unit vectors in the sensor's frame."""


class Ranges(msgspec.Struct, frozen=True, kw_only=True):
    """One scan: point = direction x (steps x step_m), all in float32, ring by ring.

    Each part is packed with zlib. The steps of each ray with a return, less those of the return
    before (0 for the first), zigzag: 0, -1, 1, -2 ... are 0, 1, 2, 3 ...
    """

    points: Count
    present: bytes
    """A bit for each ray, the first in the highest: whether there is a return."""
    low: bytes
    """The lower byte of each."""
    high: bytes


class RobotInFrame(msgspec.Struct, frozen=True, kw_only=True):
    """One robot in one frame."""

    pose: Vector6
    """Sensor in the world: x, y, z, roll, pitch, yaw."""
    velocity: Vector3
    """0 where the scan was not recorded."""
    points: Count | None
    """Of its scan; None where the scan was not recorded."""


class Frame(msgspec.Struct, frozen=True, kw_only=True):
    """Every robot in one frame. It is written after the frame's scans: where it is, they are."""

    frame: Count
    """The swarm's number."""
    capture_ns: Count
    robots: dict[str, RobotInFrame]


class Box(msgspec.Struct, frozen=True, kw_only=True):
    """An oriented box in the world frame."""

    center: Vector3
    size: Vector3
    heading: float
    label: str
    score: float = 1.0


class TrueBox(Box, frozen=True, kw_only=True):
    """A box that is really there."""

    id: str
    visible_points: Count
    """Of all robots' scans."""


class Truth(msgspec.Struct, frozen=True, kw_only=True):
    """The true boxes of one frame, where the world knows them."""

    frame: Count
    boxes: tuple[TrueBox, ...]


class KnownBox(Box, frozen=True, kw_only=True):
    """A robot that a beacon told of: its body."""

    robot: str
    age_s: float
    """Since the pose that it told."""
    doubt: str = ""
    """Why it may have stood elsewhere."""


class Track(Box, frozen=True, kw_only=True):
    """An object that the ego remembers, at a frame's time. The score is the chance that it is
    there, and in this place."""

    id: Count
    """The same object has the same one, as long as the ego's process lives."""
    velocity: tuple[float, float]
    """Along x and y, m/s."""
    age_s: float
    """Since anybody has seen it; 0 in this frame."""


class Fused(msgspec.Struct, frozen=True, kw_only=True):
    """What an ego found in one frame together with its participants."""

    ego: str
    cycle: Count
    frame: Count
    capture_ns: Count
    algorithm: str
    participants: tuple[str, ...]
    """Whose observation was fused; the ego first."""
    missing: dict[str, str]
    """Who was asked and is not in it, and why."""
    bytes: dict[str, Count]
    """Payload bytes received, by robot."""
    latency_ms: float
    boxes: tuple[Box, ...]
    known: tuple[KnownBox, ...] | None = None
    """Robots that are not among the boxes; None in older recordings, whose boxes hold the bodies of
    participants."""
    forms: dict[str, str] = msgspec.field(default_factory=dict)
    """What each participant has sent, in a frame of several forms."""
    ages_ms: dict[str, float] = msgspec.field(default_factory=dict)
    """By how much a participant's observation is older than the frame, where it is of another
    time; its scan of that time is not recorded with the frame."""
    corrections: dict[str, Vector3] | None = None
    """By what participants' poses were put right: x, y, turn; None in older recordings."""
    focused: tuple[str, ...] = ()
    """Participants that sent only what they saw in the places of what was remembered."""
    objects_only: tuple[str, ...] = ()
    """Participants that sent only points that may be objects."""
    tracks: tuple[Track, ...] | None = None
    """What is there by this frame and all before; the boxes are of this frame alone. None where the
    ego keeps no memory, and in older recordings."""


class Budget(msgspec.Struct, frozen=True, kw_only=True):
    """What the link can carry, beside what is used of it; with every fused frame."""

    frame: Count
    bytes: Count
    """Payloads of this frame."""
    used_bps: float
    """Payloads of the last second."""
    capacity_bps: float | None
    """C(t) of the last decision; None before the first."""
