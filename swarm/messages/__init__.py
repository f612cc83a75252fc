"""Messages between the processes of a swarm: MessagePack maps with a schema version.

A message is encoded with `encode` and read with `decode`, which checks types, ranges and
finiteness, so that code behind the boundary never meets NaN positions or unknown algorithms.
Times are integer nanoseconds since the epoch on the sender's clock, positions metres in the world
frame, angles radians, rates bit/s, sizes bytes.
"""

from __future__ import annotations

from swarm.messages.base import (
    ALGORITHMS,
    MAX_MESSAGE_BYTES,
    MIXED,
    SCHEMA_VERSION,
    Algorithm,
    Count,
    Message,
    Ns,
    RobotId,
    Source,
)
from swarm.messages.ego import (
    AdviceReport,
    AdviceState,
    AnswerReport,
    Assignment,
    Decision,
    Detections,
    KnownRobot,
    Probe,
    Tracks,
)
from swarm.messages.intent import (
    Focus,
    Intent,
    Site,
    intent_from_json,
    intent_to_json,
    problems,
)
from swarm.messages.llm import (
    MAX_PROMPT_CHARS,
    ChatMessage,
    DecideAnswer,
    DecideRequest,
    GatewayState,
    LlmTimings,
    LlmTokens,
)
from swarm.messages.net import (
    MAX_RATE_BPS,
    MIN_RATE_BPS,
    Backlog,
    ClassName,
    Direction,
    Directions,
    LinkClass,
    LinkState,
    NetDemand,
    NetState,
    Profile,
    ShapeInForce,
    ShapeReply,
    ShapeRequest,
    TcpState,
)
from swarm.messages.obeyed import (
    Effect,
    Expected,
    IntentInForce,
    IntentTold,
    Place,
)
from swarm.messages.robot import Beacon, Observation, ObservationRequest, Refusal, SceneDescription
from swarm.messages.steer import EgoSteered, EgoSteering, EgoWish, RobotSteered, RobotSteering
from swarm.messages.trust import CertificateRequest, RenewedCertificate
from swarm.messages.wire import decode, encode
from swarm.messages.wish import WishAnswer, WishRequest

__all__ = [
    "ALGORITHMS",
    "MAX_MESSAGE_BYTES",
    "MAX_PROMPT_CHARS",
    "MAX_RATE_BPS",
    "MIN_RATE_BPS",
    "MIXED",
    "SCHEMA_VERSION",
    "AdviceReport",
    "AdviceState",
    "Algorithm",
    "AnswerReport",
    "Assignment",
    "Backlog",
    "Beacon",
    "CertificateRequest",
    "ChatMessage",
    "ClassName",
    "Count",
    "DecideAnswer",
    "DecideRequest",
    "Decision",
    "Detections",
    "Direction",
    "Directions",
    "Effect",
    "EgoSteered",
    "EgoSteering",
    "EgoWish",
    "Expected",
    "Focus",
    "GatewayState",
    "Intent",
    "IntentInForce",
    "IntentTold",
    "KnownRobot",
    "LinkClass",
    "LinkState",
    "LlmTimings",
    "LlmTokens",
    "Message",
    "NetDemand",
    "NetState",
    "Ns",
    "Observation",
    "ObservationRequest",
    "Place",
    "Probe",
    "Profile",
    "Refusal",
    "RenewedCertificate",
    "RobotId",
    "RobotSteered",
    "RobotSteering",
    "SceneDescription",
    "ShapeInForce",
    "ShapeReply",
    "ShapeRequest",
    "Site",
    "Source",
    "TcpState",
    "Tracks",
    "WishAnswer",
    "WishRequest",
    "decode",
    "encode",
    "intent_from_json",
    "intent_to_json",
    "problems",
]
