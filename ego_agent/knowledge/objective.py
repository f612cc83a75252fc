"""The objective of the swarm: maximise Q(P, a) - lambda C(P, a).

Subject to Q(P, a) >= Q_min, and to what the link carries. The cost counts what a choice takes of
the ego's cell, of the ego's processor and of the participants'. docs/decision.md has the formulas.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.defaults import COMM_RANGE_M, Q_MIN
from swarm.messages.choices import QMin

BYTES_A_MEGABYTE = 1e6
TENTHS = 10.0
Weight = Annotated[float, msgspec.Meta(ge=0, le=1e6)]
Headroom = Annotated[float, msgspec.Meta(gt=0, le=1)]


class Objective(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Weights and limits of a decision."""

    lambda_link: Weight = 0.01
    """Quality that a tenth of the cell must bring."""
    lambda_compute: Weight = 0.02
    """Quality that a tenth of a processor must bring, of the ego's or a participant's."""
    lambda_cost: Weight = 0.0
    """Quality that one megabyte a fused frame must bring beside these, however wide the cell."""
    q_min: QMin = Q_MIN
    """Smallest predicted quality that is good enough."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 10.0
    """Fused frames a second, each of which costs C(P, a)."""
    deadline_s: Annotated[float, msgspec.Meta(gt=0, le=60)] = 0.25
    """How long a frame waits for the robots at that rate."""
    slower_hz: tuple[Annotated[float, msgspec.Meta(gt=0, le=1000)], ...] = ()
    """Lower rates that a decision may choose instead."""
    rarer_hz: tuple[Annotated[float, msgspec.Meta(gt=0, le=1000)], ...] = ()
    """Lower rates at which single robots may contribute to frames that are fused more often, as
    memory carries on what they showed."""
    places_hz: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 0.0
    """How often, at most, these are asked in between about the places of what is remembered, where
    their algorithm can tell of places alone; 0: not at all."""
    comm_range_m: Annotated[float, msgspec.Meta(gt=0, le=1e5)] = COMM_RANGE_M
    """Farthest participant, in the ground plane."""
    headroom: Headroom = 0.8
    """Share of C(t) that observations may fill: the rest is for beacons, scenes and errors."""
    alpha: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.5
    """Weight of area in Q; the rest weighs objects."""
    area_half_m: Annotated[float, msgspec.Meta(ge=1, le=500)] = 70.0
    """Half the side of the square around the ego that counts."""
    beacon_max_age_s: Annotated[float, msgspec.Meta(gt=0, le=3600)] = 1.0
    """An older beacon disqualifies its robot: ten beacon periods."""
    scene_max_age_s: Annotated[float, msgspec.Meta(gt=0, le=3600)] = 5.0
    """An older scene description counts as none: ten scene periods."""
    proposal_max_age_s: Annotated[float, msgspec.Meta(gt=0, le=3600)] = 10.0
    """An older proposal is refused."""
    switch_gain: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.02
    """A new decision must be better by this much than the one in force."""
    dwell_s: Annotated[float, msgspec.Meta(ge=0, le=3600)] = 10.0
    """A decision stays at least this long, unless it cannot be carried on, loses Q_min or brings
    nothing."""
    upgrade_reserve: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.1
    """Share of the budget that a change to a more costly decision must leave free."""

    def budget_bytes(self, capacity_bps: float, rate_hz: float | None = None) -> int:
        """Bytes that one fused frame may cost on a link of that capacity, at that rate."""
        rate_hz = self.rate_hz if rate_hz is None else rate_hz
        return int(capacity_bps * self.headroom / (8.0 * rate_hz))

    def cost(
        self, cost_bytes: float, capacity_bps: float, compute_s: float, rate_hz: float
    ) -> float:
        """lambda C, in quality: of so many bytes and seconds of processors a frame, on a cell of
        that capacity."""
        link = 8.0 * rate_hz * cost_bytes / max(1.0, capacity_bps)
        processors = rate_hz * compute_s
        return (
            TENTHS * (self.lambda_link * link + self.lambda_compute * processors)
            + self.lambda_cost * cost_bytes / BYTES_A_MEGABYTE
        )
