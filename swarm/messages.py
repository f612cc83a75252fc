"""Messages between the processes of a swarm: MessagePack maps with a schema version.

A message is encoded with `encode` and read with `decode`, which checks types, ranges and
finiteness, so that code behind the boundary never meets NaN positions or unknown algorithms.
Times are integer nanoseconds since the epoch on the sender's clock, positions metres in the world
frame, angles radians, rates bit/s, sizes bytes.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from swarm.arrays import Array
from swarm.errors import MessageError
from swarm.geometry import Pose

SCHEMA_VERSION = 1
MAX_MESSAGE_BYTES = 8 * 1024 * 1024
"""Larger messages are refused unread: ten times a raw 64-ring scan."""

Algorithm = Literal["early", "intermediate", "late"]
ALGORITHMS: tuple[Algorithm, ...] = ("early", "intermediate", "late")
Source = Literal["policy", "llm", "cache", "fallback", "hold"]

RobotId = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]
Version = Annotated[int, msgspec.Meta(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
Count = Annotated[int, msgspec.Meta(ge=0)]
Ns = Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)]
"""Until the year 2116; offsets can be added without leaving 64 bits."""
Positive = Annotated[float, msgspec.Meta(gt=0)]
Bounded = Annotated[float, msgspec.Meta(ge=-1e7, le=1e7)]
"""Metres, radians or metres a second of anything on this planet; finite as float32, too."""
Vector6 = tuple[Bounded, Bounded, Bounded, Bounded, Bounded, Bounded]
Vector3 = tuple[Bounded, Bounded, Bounded]
AlgorithmName = Annotated[str, msgspec.Meta(max_length=32)]
Sizes = Annotated[dict[AlgorithmName, Count], msgspec.Meta(max_length=16)]


class Message(msgspec.Struct, kw_only=True, frozen=True):
    """Base of all messages; `v` is the schema version."""

    v: Version = SCHEMA_VERSION


class Beacon(Message, frozen=True, kw_only=True):
    """Where a robot is and what its observation would cost now; 10 Hz."""

    robot: RobotId
    instance: Count
    """Random number drawn at process start: two robots with one id differ in it."""
    seq: Count
    sent_ns: Ns
    capture_ns: Ns
    frame: Count
    pose: Vector6
    """Sensor in the world: x, y, z, roll, pitch, yaw."""
    velocity: Vector3
    range_m: Positive
    """Reach of the sensor."""
    sizes: Sizes
    """Encoded bytes of the newest measured frame by algorithm name, ready to be sent."""

    def sensor_pose(self) -> Pose:
        """The sensor's pose in the world frame."""
        return Pose(*self.pose)


class SceneDescription(Message, frozen=True, kw_only=True):
    """What a robot sees, in the world frame (Scene Abstraction Module); 2 Hz."""

    robot: RobotId
    instance: Count
    seq: Count
    sent_ns: Ns
    capture_ns: Ns
    frame: Count
    pose: Vector6
    objects: Array
    """float32 (N, 9): centroid x, y, z (world), distance m, size x, y, z m, points, density /m3."""
    visible_m: Array
    """float32 (S, 1): for S equal sectors of world azimuth from 0, how far the ground is seen."""
    ground_points: Count
    elapsed_ms: Annotated[float, msgspec.Meta(ge=0)]

    def sensor_pose(self) -> Pose:
        """The sensor's pose in the world frame."""
        return Pose(*self.pose)


class ObservationRequest(Message, frozen=True, kw_only=True):
    """The ego asks a robot for one frame in one form."""

    ego: RobotId
    request: Count
    algorithm: Algorithm
    capture_ns: Ns
    """Wanted capture time on the robot's own clock; 0 asks for the newest frame."""
    max_error_m: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.1
    """Bound on the position error of coded points."""
    keep_ground: bool = False
    max_bytes: Annotated[int, msgspec.Meta(ge=1)] = MAX_MESSAGE_BYTES
    """A larger payload is refused instead of sent."""


class Observation(Message, frozen=True, kw_only=True):
    """One frame of one robot, as asked."""

    robot: RobotId
    instance: Count
    request: Count
    algorithm: Algorithm
    capture_ns: Ns
    frame: Count
    pose: Vector6
    payload: bytes
    encode_ms: Annotated[float, msgspec.Meta(ge=0)]

    def sensor_pose(self) -> Pose:
        """The sensor's pose in the world frame."""
        return Pose(*self.pose)


class Refusal(Message, frozen=True, kw_only=True):
    """Why a robot answers a request with an error (sent as an error reply)."""

    robot: str
    request: Count
    reason: str


class Decision(Message, frozen=True, kw_only=True):
    """Who takes part in the fusion and with which algorithm, and where that came from."""

    ego: RobotId
    cycle: Count
    decided_ns: Ns
    participants: tuple[RobotId, ...]
    """Always holds the ego, first."""
    algorithm: Algorithm
    reason: str
    source: Source
    policy: str
    valid: bool
    """False only where even the ego alone could not be confirmed."""
    repairs: tuple[str, ...] = ()
    """What validation changed in the proposal, one sentence each."""
    quality: float = 0.0
    """Predicted Q(P, a) in [0, 1]."""
    cost_bytes: Count = 0
    """Predicted C(P, a): bytes a fused frame over all participants but the ego."""
    rate_hz: Positive = 10.0
    capacity_bps: Positive = 1.0
    """C(t) that the decision was checked against."""


class Detections(Message, frozen=True, kw_only=True):
    """Fused boxes of one frame in the world frame."""

    ego: RobotId
    cycle: Count
    frame: Count
    capture_ns: Ns
    algorithm: Algorithm
    participants: tuple[RobotId, ...]
    """Whose observation arrived in time and was fused; the ego first."""
    missing: dict[str, str] = {}
    """Participants that are not in the result, and why."""
    boxes: Array
    """float32 (N, 7): centre x, y, z, length, width, height, heading."""
    scores: Array
    """float32 (N, 1) in [0, 1]."""
    labels: tuple[str, ...]
    bytes: dict[str, Count]
    """Payload bytes received, by robot."""
    latency_ms: Annotated[float, msgspec.Meta(ge=0)]
    """From the first query to the fused boxes."""


class LinkClass(msgspec.Struct, frozen=True, kw_only=True):
    """Counters of one traffic class on one link."""

    rate_bps: Count
    sent_bytes: Count
    backlog_bytes: Count
    drops: Count


class NetState(Message, frozen=True, kw_only=True):
    """What the network controller configured on the cell towards the ego, 1 Hz."""

    sent_ns: Ns
    capacity_bps: Positive
    classes: dict[str, LinkClass] = {}


M = TypeVar("M", bound=Message)
_ENCODER = msgspec.msgpack.Encoder()
_DECODERS: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {
    kind: msgspec.msgpack.Decoder(kind)
    for kind in (
        Beacon,
        SceneDescription,
        ObservationRequest,
        Observation,
        Refusal,
        Decision,
        Detections,
        NetState,
    )
}


def encode(message: Message) -> bytes:
    """The MessagePack bytes of a message."""
    return _ENCODER.encode(message)


def decode(data: bytes, kind: type[M]) -> M:
    """A validated message of the given kind.

    Raises MessageError for too many bytes, malformed MessagePack, another schema version, a field
    of the wrong type or out of range, and a number that is not finite.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError(
            f"{kind.__name__} of {len(data)} bytes is larger than {MAX_MESSAGE_BYTES}"
        )
    try:
        message: M = _DECODERS[kind].decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"not a valid {kind.__name__}: {error}") from error
    for name in message.__struct_fields__:
        if not _is_finite(getattr(message, name)):
            raise MessageError(f"{kind.__name__}.{name} is not finite")
    return message


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(_is_finite(item) for item in value)
    return True
