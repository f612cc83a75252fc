"""The interface of a fusion algorithm: what a robot sends, and how the ego fuses it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from perception.fusion.aligner import Corrections
from perception.types import Boxes
from swarm.errors import PerceptionError
from swarm.geometry import Matrix, Points, Pose

REFERENCE_BYTES = 24
"""A pose of six float32."""


@dataclass(frozen=True, slots=True)
class EncodeOptions:
    """What the ego asks of the robot's encoder."""

    max_error_m: float = 0.1
    """Bound on the Euclidean error of any coded point."""
    keep_ground: bool = False
    """All points of scans: ground, and all of what is too tall to be an object, too."""
    pose: Pose | None = None
    """The robot's own sensor in the world at capture."""
    reference: Pose | None = None
    """The frame that feature maps shall lie in: the ego's sensor in the world."""
    demand: bytes = b""
    """What the ego wants to know, in the algorithm's own form; empty: everything."""
    without_outline: bool = False
    """The ego knows by what the sender's pose is off: what is said of places needs no outline."""
    objects_only: bool = False
    """Of points, only those that may be objects: the ego asks about their places in between."""
    egos: tuple[Pose, ...] = ()
    """Where several egos stood that share the payload; of a `shareable` algorithm only, and in
    place of `reference` and `demand`."""


@dataclass(frozen=True, slots=True)
class FrameRequest:
    """What the ego tells robots when it asks them for a frame."""

    reference: Pose | None = None
    demand: bytes = b""
    without_outline: bool = False
    objects_only: bool = False
    """Both as in `EncodeOptions`."""

    def size(self) -> int:
        """Bytes that this adds to a request."""
        return len(self.demand) + (REFERENCE_BYTES if self.reference is not None else 0)


@dataclass(frozen=True, slots=True)
class Contribution:
    """A payload as it arrived, with the sender's sensor pose at capture."""

    robot: str
    payload: bytes
    world_from_sensor: Matrix
    age_s: float = 0.0
    """How long before the ego's scan of the frame it was captured; negative: after it."""
    form: str = ""
    """The algorithm whose form the payload has; empty: that of the frame's fusion."""


@dataclass(frozen=True, slots=True)
class FusionResult:
    """Fused boxes in the world frame, and the robots whose payload could not be used, with why."""

    boxes: Boxes
    rejected: dict[str, str]


class Gathering(ABC):
    """One frame's fusion at the ego, while contributions come in."""

    stood_at: tuple[float, float] = (0.0, 0.0)
    """Where the ego stood when the scan was taken, in the frame of its points: elsewhere where an
    older scan is told in the present's frame."""
    remembered: Corrections | None = None
    """What is known of senders' poses from the frames before."""

    def ask(self) -> FrameRequest:
        """What robots must be told before they encode."""
        return FrameRequest()

    def ask_for(self, form: str) -> FrameRequest:
        """The same for robots that send this form, where a frame has several."""
        return self.ask()

    def prepare(self) -> None:
        """Does what needs no contribution, while those who were asked encode theirs. May be left
        out: `finish` makes up for it."""
        return None

    @abstractmethod
    def add(self, contribution: Contribution) -> None:
        """Takes up a contribution when it arrives.

        Raises PerceptionError when its payload cannot be used; the others are not affected.
        """

    @abstractmethod
    def finish(self) -> Boxes:
        """The boxes of all that was taken up, in the world frame."""

    def corrections(self) -> dict[str, Matrix]:
        """After `finish`: what brings senders from where they believe to be to where what they see
        shows them, 4 x 4 in the world frame, by robot. Of those that are not corrected, none."""
        return {}

    def left_out(self) -> dict[str, str]:
        """After `finish`: robots that were taken up but are not in it, with why: what they see does
        not show where they are."""
        return {}

    def sent_points(self) -> dict[str, tuple[Points, Matrix]]:
        """After `finish`: the points that are in it, float32 (N, 3) in their sensors' frames, and
        the sensors in the world frame, corrected, by robot. Of those that sent none, none."""
        return {}


class Fusion(ABC):
    """A fusion algorithm; instances hold no state between frames."""

    name: str
    corrects = True
    """Whether the poses of senders are corrected before fusing."""
    shareable = False
    """Whether several egos can fuse one payload, encoded without `reference` and `demand`."""
    focuses = False
    """Whether `demand` may be the places (perception/codec/places.py) that the ego asks about."""
    scored_as: str | None = None
    """The algorithm whose calibration its boxes' scores have, where it is not its own name; empty:
    they are of another detector than the world's, so nobody's."""

    @abstractmethod
    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """Robot side: a scan, float32 (N, 3) in the sensor's frame, as a payload."""

    @abstractmethod
    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Ego side: starts a frame with the own scan, float32 (N, 3) in the sensor's frame."""

    def fuse(
        self, own: Points, world_from_own: Matrix, contributions: Sequence[Contribution]
    ) -> FusionResult:
        """Own scan and contributions to boxes in the world frame, all at once.

        A contribution that cannot be used is left out and named in `rejected`.
        """
        gathering = self.begin(own, world_from_own)
        rejected = {}
        for item in contributions:
            try:
                gathering.add(item)
            except PerceptionError as error:
                rejected[item.robot] = str(error)
        boxes = gathering.finish()
        return FusionResult(boxes, rejected | gathering.left_out())
