"""Settings that more than one part has: what is allowed and what holds where nobody says.

An ego's own settings, what a swarm is started with, what operators may ask for and what the console
shows refer to these.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.messages.choices import QMin
from swarm.settings import Name

SWARM: Name = "local"
POLICY: Name = "coverage"
ALGORITHM = "early"
"""What a person fuses with who names none; egos decide by themselves."""
Period = Annotated[float, msgspec.Meta(ge=0.05, le=3600, description="seconds")]
PERIOD_S: Period = 1.0
"""Time between two decisions; the paper uses 5 s."""
Q_MIN: QMin = 0.6
"""Smallest predicted quality that is good enough."""
CommRange = Annotated[float, msgspec.Meta(gt=0, le=10_000, description="metres")]
COMM_RANGE_M: CommRange = 45.0
"""Farthest participant, in the ground plane; the paper's com_range_m in most scenes."""

ROUTER_PORT = 7447
"""First of three, one a traffic class."""
QOD_PORT = 9104
LLM_PORT = 9106
CONSOLE_PORT = 8080
