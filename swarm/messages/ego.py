"""What an ego says: what it decided, and what it saw together with its participants."""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.arrays import Array
from swarm.messages.base import Algorithm, Count, Message, Ns, Positive, RobotId, Source


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
    model: Annotated[str, msgspec.Meta(max_length=200)] = ""
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
    missing: dict[str, str] = msgspec.field(default_factory=dict)
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
