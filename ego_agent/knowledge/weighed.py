"""What a decision was weighed against, as the journal's line holds it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from swarm.messages import Algorithm

MAX_WEIGHED = 16
"""Robots of one line that are weighed: they bound its size."""
Verdict = Literal["pays", "q_min", "kept", "costs", "fit", "link", "size"]
"""Why a robot is in or out: it adds more than it costs; it does not, but Q_min takes it; a change
does not pay, or the policy wants it so; it costs more than it adds; it does not fit the ego's link
beside the others; its own link does not carry it; the size of its observation is not known."""


class Weighing(msgspec.Struct, frozen=True, kw_only=True):
    """What one robot brings to the decision beside its other participants, or would bring."""

    adds: float | None
    """Quality; None where it cannot send for the algorithm."""
    costs: float | None
    """lambda C, in quality."""
    why: Verdict


class Other(msgspec.Struct, frozen=True, kw_only=True):
    """The best choice of other robots or another algorithm that was found."""

    participants: tuple[str, ...]
    """The ego first."""
    algorithm: Algorithm
    rate_hz: float
    quality: float
    cost_bytes: int
    budget_bytes: int
    """What a frame may cost at that rate."""
    value: float
    """Q - lambda C."""


class Weighed(msgspec.Struct, frozen=True, kw_only=True):
    """What the decision was weighed against."""

    value: float
    """Of the decision, Q - lambda C."""
    budget_bytes: int
    """What a frame may cost at the decision's rate."""
    q_min: float
    switch_gain: float
    """By how much another choice must be better to be taken."""
    dwell_s: float
    """How long a decision stays."""
    upgrade_reserve: float
    """Share of the budget that a more costly choice must leave free."""
    robots: Mapping[str, Weighing]
    """Participants, then those that would add most: MAX_WEIGHED in all."""
    left_out: int = 0
    """Candidates beyond them."""
    other: Other | None = None
    """None where nothing else can be chosen."""
