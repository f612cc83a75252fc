"""Clocks of single processes that are stepped by hours while they run (`clock_step.c`).

The world of a simulated robot is a function of the time, so a robot whose clock is stepped stands
elsewhere, too.
"""

from __future__ import annotations

import random
import struct
from pathlib import Path

from research.chaos.faults.base import Begin, End, Kind
from research.chaos.history import Fault
from research.chaos.stage import Stage

HOURS = (2.5, 30.0)


def step_s(fault: Fault) -> float:
    """By how much the clock is put ahead; behind where it is negative."""
    chance = random.Random(fault.seed)
    return round(chance.choice((-1, 1)) * chance.uniform(*HOURS) * 3600.0, 3)


def _step(name: str) -> Begin:
    def begin(stage: Stage, fault: Fault) -> End:
        path = stage.clock(name or fault.target)
        seconds = step_s(fault)
        _write(path, seconds)

        def end() -> str:
            _write(path, 0.0)
            return f"the clock of {path.name} was {seconds / 3600:+.1f} h off"

        return end

    return begin


def _write(path: Path, seconds: float) -> None:
    # The processes have mapped the file, so it must stay the same one.
    with open(path, "r+b", buffering=0) as file:
        file.write(struct.pack("=q", round(seconds * 1e9)))


OFF_S = (3.0, 6.0)
KINDS = (
    Kind("clock-robot", _step(""), OFF_S, "target", targets=True, needs="clocks"),
    Kind("clock-ego", _step("ego"), OFF_S, "everybody", ("ego", "journal"), needs="clocks"),
    Kind("clock-controller", _step("controller"), OFF_S, "nobody", ("controller",), needs="clocks"),
)
