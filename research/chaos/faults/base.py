"""What a kind of fault is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from research.chaos.history import Fault
from research.chaos.stage import Stage

End = Callable[[], str]
"""Ends a fault that has begun, and says what was seen of it."""
Begin = Callable[[Stage, Fault], End]
Sign = Literal["none", "beacon", "process", "decision", "anything", "controller"]
"""What tells that what was hit is there again: nothing is needed; a beacon of the robot; a beacon
of another process of it; a decision; any message; the network controller's state."""
Hits = Literal["nobody", "target", "everybody"]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault."""

    name: str
    begin: Begin
    lasts_s: tuple[float, float]
    """The shortest and the longest that a schedule has."""
    hits: Hits
    """Whom it may keep from taking part."""
    holds: tuple[str, ...] = ()
    """Parts of the swarm that no other fault may hold meanwhile, beside the target."""
    targets: bool = False
    """Whether it hits one robot."""
    sign: Sign = "none"
    ego_down: bool = False
    rest_s: float = 3.0
    """For how long what it holds is left alone afterwards."""
    needs: Literal["", "clocks", "secure"] = ""
    """What has to be there to play it."""
    outside: bool = False
    """Only what a process from outside says: in a secure swarm it hits nobody but the robot whose
    certificate was stolen."""
