"""What robots say: where they are, what they see, and what they are asked for."""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.arrays import Array
from swarm.body import Body
from swarm.geometry import Pose
from swarm.messages.base import (
    MAX_MESSAGE_BYTES,
    Algorithm,
    Count,
    Mark,
    Message,
    Ns,
    Positive,
    RobotId,
    Sizes,
    Software,
    Vector3,
    Vector6,
)
from swarm.messages.net import Backlog, NonNegative


class Beacon(Message, frozen=True, kw_only=True):
    """Where a robot is and what its observation would cost now; 10 Hz, fewer on narrow links."""

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
    """Encoded bytes of the newest measured frame by algorithm name, ready to be sent. Empty: as in
    the beacon before; a robot that is to speak little tells them rarely."""
    body: Body | None = None
    """What others see of it; None: it does not say, or as in the beacon before where `sizes` are
    left out, too."""
    steady_ns: Ns = 0
    """When it was sent on the robot's steady clock, which nobody sets; 0: it does not say."""
    echoes: Annotated[dict[RobotId, tuple[Ns, Ns]], msgspec.Meta(max_length=8)] = msgspec.field(
        default_factory=dict
    )
    """By ego: `steady_ns` of its newest `NetDemand`, and this robot's steady clock when that came.
    Only in the first beacon after it."""
    world: Mark = ""
    """The mark of its world (`swarm.fitting`), about once a second, or in each fifth beacon where
    these are few; else, and where it does not say, empty."""
    software: Software = ""
    """The package's version, told with `world`."""
    shared: Annotated[tuple[Algorithm, ...], msgspec.Meta(max_length=16)] = ()
    """What it publishes at present for several egos: one more takes nothing of its link."""

    def sensor_pose(self) -> Pose:
        """The sensor's pose in the world frame."""
        return Pose(*self.pose)


class SceneDescription(Message, frozen=True, kw_only=True):
    """What a robot sees, in the world frame (Scene Abstraction Module); 2 Hz, fewer on
    narrow links, and with fewer objects and sectors there."""

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
    """All points of the scan: ground, and all of walls and racks, too."""
    max_bytes: Annotated[int, msgspec.Meta(ge=1)] = MAX_MESSAGE_BYTES
    """A larger payload is refused instead of sent."""
    reference: Vector6 | None = None
    """The pose in whose frame feature maps shall lie; the robot's own where none is given."""
    demand: Annotated[bytes, msgspec.Meta(max_length=4096)] = b""
    """What the ego wants to know, in the algorithm's own form; empty: everything."""
    without_outline: bool = False
    """The ego knows by what robots' poses are off: an answer about places needs no outline."""
    objects_only: bool = False
    """Of points, only those that may be objects: the ego asks about their places in between."""
    shares: bool = False
    """The ego would also take what the robot publishes for several egos (`keyspace.shared`)."""
    listens: bool = False
    """It receives that already: an answer of its own is needed only where nothing is published."""
    rate_hz: NonNegative = 0.0
    """Frames a second that the ego will want, where it shares; 0: all that there are."""
    deadline_s: NonNegative = 0.0
    """How soon the answer has to be there to be fused; 0: the ego does not say."""

    def reference_pose(self) -> Pose | None:
        """`reference` as a pose in the world frame."""
        return None if self.reference is None else Pose(*self.reference)


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
    """Time that passed from the question, or from the frame where it is published, to the
    payload."""
    work_ms: NonNegative = 0.0
    """Processor time that encoding it took, in the thread that did; 0: the robot does not say."""
    uplink: Backlog = Backlog()
    """Of what the robot's process has sent in the fusion class since its start, by its kernel."""
    shared_s: NonNegative = 0.0
    """For so long the robot publishes its frames in this algorithm for several egos; 0: it does
    not. The payload is empty where it is among what is published, and the ego listens."""

    def sensor_pose(self) -> Pose:
        """The sensor's pose in the world frame."""
        return Pose(*self.pose)


class Refusal(Message, frozen=True, kw_only=True):
    """Why a robot answers a request with an error (sent as an error reply)."""

    robot: str
    request: Count
    reason: str
    code: Annotated[str, msgspec.Meta(max_length=32)] = ""
    """The kind of the reason, where the process names one (`swarm.errors.CoAdaptError.code`)."""
