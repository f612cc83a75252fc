"""What `coadapt status` and others show of a running swarm."""

from __future__ import annotations

from typing import Literal

import msgspec

from swarm.messages import AdviceReport, Assignment, IntentTold

RobotState = Literal["well", "off duty", "lost", "silent", "stalled"]
"""Lost: neither its token nor its process is there. Silent: its process answers, but no beacons
come. Stalled: its token is there, but its process answers nothing."""


class RobotRow(msgspec.Struct, frozen=True, kw_only=True):
    """One robot, as seen from the host."""

    robot: str
    alive: bool
    """Its liveliness token is present."""
    age_s: float | None
    """Since it sensed what is known of it, here or, if that is older, to the ego; None when no
    beacon has come yet."""
    position: tuple[float, float, float] | None
    """Its sensor in the world frame, metres."""
    distance_m: float | None
    """To the ego, in the ground plane."""
    selected: bool
    """The last decision has it take part."""
    bytes_per_s: float
    """Observations that the ego received from it."""
    state: RobotState | None = None
    """None where that is not known yet."""
    why: str = ""
    """Why the ego leaves it out or gets nothing of it, or who took it off duty."""


class EgoRow(msgspec.Struct, frozen=True, kw_only=True):
    """One ego of several, and the newest decision that was heard of it; None before the first."""

    ego: str
    cycle: int | None = None
    age_s: float | None = None
    """Since the decision came."""
    selected: tuple[str, ...] = ()
    algorithm: str = ""
    policy: str = ""
    source: str = ""
    valid: bool = False
    quality: float = 0.0
    capacity_bps: float | None = None


class SwarmView(msgspec.Struct, frozen=True, kw_only=True):
    """The swarm over the last moments. Fields about the decision are None before the first."""

    swarm: str
    runtime: str
    ego: str
    cycle: int | None
    selected: tuple[str, ...] | None
    algorithm: str | None
    source: str | None
    policy: str | None
    valid: bool | None
    reason: str | None
    capacity_bps: float | None
    """C(t) that the last decision was checked against."""
    cell_bps: int | None
    """What the network controller gives the cell towards the ego; None where it is not shaped."""
    cell_level: int | None
    """How far the controller has moved bandwidth towards fusion."""
    quality: float | None
    bytes_per_s: float
    frames_per_s: float
    """Fused frames that the ego published."""
    robots: tuple[RobotRow, ...]
    model: str | None = None
    """The language model whose advice the decision follows; empty for none."""
    advice: AdviceReport | None = None
    """None for policies that ask no language model."""
    blind: str = ""
    """Why the ego perceives with nobody's help against its will, or not at all."""
    model_trouble: str = ""
    """Why the LLM gateway's model does not answer."""
    stands_in_for: str | None = None
    """The ego in whose stead `ego` decides; None: in its own."""
    unshaped: tuple[str, ...] = ()
    """Why links cannot be shaped, or are not as they should be, in the controllers' words."""
    egos: tuple[EgoRow, ...] = ()
    """Every ego of the swarm, the one that is shown among them."""
    intents: tuple[IntentTold, ...] = ()
    """Operators' wishes that the decision obeys."""
    assignments: tuple[Assignment, ...] = ()
    """What each participant sends, and how often, where that is not the same of all."""
