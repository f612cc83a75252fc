"""What an ego says: what it decided, and what it saw together with its participants."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from swarm.arrays import Array
from swarm.body import Label
from swarm.messages.base import (
    Algorithm,
    Bounded,
    Count,
    Message,
    Ns,
    Positive,
    RobotId,
    Source,
    Vector3,
)
from swarm.messages.llm import LlmTokens, NonNegative
from swarm.messages.obeyed import MAX_INTENTS, IntentTold

Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
ModelName = Annotated[str, msgspec.Meta(max_length=200)]
AdviceState = Literal["none", "asked", "waiting", "adopted", "held", "refused"]
"""Adopted in this cycle; in force since an earlier one; else none is in force, and the newest
question was refused, or sent in this cycle, or has no answer yet; or there is nothing at all."""

MAX_NAMED = 256
Reasons = Annotated[dict[RobotId, str], msgspec.Meta(max_length=MAX_NAMED)]


class AnswerReport(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one question to a language model."""

    question: Count
    outcome: Annotated[str, msgspec.Meta(max_length=32)]
    """`adopted`, or the kind of reason why it was not; docs/llm.md lists them."""
    why: str = ""
    """The reason in words; empty when adopted."""
    repaired: tuple[str, ...] = ()
    """Kinds of repairs that made it usable."""
    model: ModelName = ""
    source: Literal["", "llm", "cache"] = ""
    """Where the gateway had it from; empty when no answer came."""
    latency_ms: NonNegative = 0.0
    """From the question to what came of it."""
    tokens: LlmTokens = LlmTokens()


class AdviceReport(msgspec.Struct, frozen=True, kw_only=True):
    """How an ego stands with its language model at one decision."""

    state: AdviceState
    gateway: bool
    """An LLM gateway is alive."""
    question: Count = 0
    """Number of the newest question; 0 before the first."""
    asked_s: NonNegative | None = None
    """Since the newest question; None before the first."""
    fingerprint: str = ""
    """Of the scene as it is now."""
    model: ModelName = ""
    """Whose advice is in force; empty for none."""
    age_s: NonNegative | None = None
    """Since the advice in force was adopted; None without."""
    ended: Annotated[str, msgspec.Meta(max_length=32)] = ""
    """Why the advice that was in force is not any more since this cycle."""
    refusal: str = ""
    """Why the last advice was refused or given up, in words."""
    answer: AnswerReport | None = None
    """What came of a question in this cycle."""


class Probe(msgspec.Struct, frozen=True, kw_only=True):
    """One question on the side: whether what the ego would rather have comes in time by now."""

    robot: RobotId
    algorithm: Algorithm
    bytes: Count = 0
    """What its answer is expected to cost, once."""


class Assignment(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What one participant sends, and how often."""

    robot: RobotId
    algorithm: Algorithm
    rate_hz: Positive
    """Contributions a second."""
    places_hz: NonNegative = 0.0
    """How often it is asked, where it does not contribute anyway, for what it sees in the places of
    what is remembered; 0: never."""
    objects_only: bool = False
    """Whether it contributes only points that may be objects, not their surroundings."""


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
    model: ModelName = ""
    """The language model whose advice it follows; empty for none."""
    valid: bool
    """False only where even the ego alone could not be confirmed."""
    repairs: tuple[str, ...] = ()
    """What validation changed in the proposal, one sentence each."""
    quality: float = 0.0
    """Predicted Q(P, a) in [0, 1]."""
    cost_bytes: Count = 0
    """Predicted C(P, a): bytes a fused frame over all participants but the ego."""
    rate_hz: Positive = 10.0
    """Fused frames a second."""
    capacity_bps: Positive = 1.0
    """C(t) that the decision was checked against."""
    advice: AdviceReport | None = None
    """None for policies that ask no language model."""
    deadline_s: Positive | None = None
    """How long a frame waits for the robots; None leaves it to the ego's settings."""
    arrival: dict[RobotId, Share] = msgspec.field(default_factory=dict)
    """Probability that each participant's observation is in time, as far as it has been learnt."""
    probe: Probe | None = None
    """A question beside the decision, in its first frame."""
    held_s: NonNegative | None = None
    """Since participants, algorithm or rate were changed last; None: not known."""
    blind: str = ""
    """Why the ego perceives with nobody's help against its will, or not at all: nobody is heard,
    nothing of what was chosen arrives, its own state is not known. Empty while it is not."""
    excluded: Reasons = msgspec.field(default_factory=dict)
    """Robots that could not be chosen, and why."""
    silent: Reasons = msgspec.field(default_factory=dict)
    """Robots that are chosen but of which nothing arrives, and why."""
    doubted: Reasons = msgspec.field(default_factory=dict)
    """Robots whose beacon contradicts what others see, and how."""
    ages_s: Annotated[dict[RobotId, NonNegative], msgspec.Meta(max_length=MAX_NAMED)] = (
        msgspec.field(default_factory=dict)
    )
    """How long ago each robot sensed what the ego knows of it."""
    stands_in_for: RobotId | None = None
    """The ego in whose stead this one decides; None: in its own."""
    remarks: Reasons = msgspec.field(default_factory=dict)
    """What is odd about robots that may take part all the same: a clock that is off, another
    version of the software."""
    assignments: Annotated[tuple[Assignment, ...], msgspec.Meta(max_length=MAX_NAMED)] = ()
    """What each participant but the ego sends, where that is not the same of all in every fused
    frame; empty: it is."""
    intents: Annotated[tuple[IntentTold, ...], msgspec.Meta(max_length=MAX_INTENTS)] = ()
    """Which the decision obeys, oldest first."""


class KnownRobot(msgspec.Struct, frozen=True, kw_only=True):
    """A robot that a beacon tells of: its body at the time of a frame, in the world frame."""

    robot: RobotId
    label: Label
    center: Vector3
    size: Vector3
    heading: Bounded
    age_s: NonNegative
    """Since the pose that it told."""
    velocity: tuple[Bounded, Bounded] | None = None
    """Along x and y, m/s, as it tells; None by older programs."""
    doubt: str = ""
    """Why it may stand elsewhere; empty where nobody contradicts."""


class Tracks(msgspec.Struct, frozen=True, kw_only=True):
    """Objects that an ego remembers, in the world frame at a frame's time, the likeliest first."""

    ids: Annotated[tuple[Count, ...], msgspec.Meta(max_length=MAX_NAMED)]
    """The same object has the same number, as long as the ego's process lives."""
    labels: Annotated[tuple[str, ...], msgspec.Meta(max_length=MAX_NAMED)]
    boxes: Array
    """float32 (N, 7): centre x, y, z, length, width, height, heading."""
    scores: Array
    """float32 (N, 1) in [0, 1]: the chance that the object is there, and in this place."""
    velocities: Array
    """float32 (N, 2): along x and y, m/s."""
    ages_s: Array
    """float32 (N, 1): since anybody has seen it; 0 in this frame."""


class Detections(Message, frozen=True, kw_only=True):
    """What was found in one frame in the world frame: objects, none of which is a known robot."""

    ego: RobotId
    cycle: Count
    frame: Count
    capture_ns: Ns
    algorithm: Algorithm
    participants: tuple[RobotId, ...]
    """Whose observation arrived in time and was fused; the ego first."""
    missing: dict[str, str] = msgspec.field(default_factory=dict)
    """Participants that are not in the result, and why."""
    known: Annotated[tuple[KnownRobot, ...], msgspec.Meta(max_length=MAX_NAMED)] = ()
    """Every robot but the ego of which a fresh beacon tells, whether it takes part or not."""
    missing_kinds: dict[str, str] = msgspec.field(default_factory=dict)
    """The kind of each reason in `missing`, one of a few words (docs/journal.md)."""
    boxes: Array
    """float32 (N, 7): centre x, y, z, length, width, height, heading."""
    scores: Array
    """float32 (N, 1) in [0, 1]: the chance that the box is right, where the detector is
    calibrated."""
    operating_point: Share | None = None
    """The score from which on boxes are published; None where nobody has calibrated the detector
    for this algorithm: all are published then, and scores only rank them."""
    labels: tuple[str, ...]
    bytes: dict[str, Count]
    """Payload bytes received, by robot."""
    latency_ms: Annotated[float, msgspec.Meta(ge=0)]
    """From the first query to the fused boxes."""
    age_ms: NonNegative | None = None
    """From the capture of the ego's scan to the publication, on the ego's clock."""
    tracks: Tracks | None = None
    """What is there by all that was found in this frame and before: no known robot, and from the
    operating point on. None where the ego keeps no memory. `boxes` are of this frame alone."""
    forms: dict[RobotId, Algorithm] = msgspec.field(default_factory=dict)
    """What each participant but the ego has sent, in a frame of several; empty where `algorithm`
    says it."""
    ages_ms: dict[RobotId, float] = msgspec.field(default_factory=dict)
    """By how much a participant's observation is older than the ego's scan (negative: newer), of
    those that are apart by a millisecond or more."""
    corrections: dict[RobotId, tuple[float, float, float]] | None = None
    """By what participants' poses were put right before they were fused: shift along the world's x
    and y in metres, and turn about the robot in radians; of those that were. None where that is
    not told, as by egos of older programs."""
    focused: tuple[RobotId, ...] = ()
    """Participants that were asked only about the places of what is remembered."""
    objects_only: tuple[RobotId, ...] = ()
    """Participants that were asked only for points that may be objects."""
