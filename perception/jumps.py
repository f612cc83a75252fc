"""Whether a pose was set anew: nobody drives or turns so much from where they were."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm.geometry import Matrix, yaw_of

Floats = NDArray[np.float64]

JUMP_M, HARDEST_M_S2 = 1.0, 10.0
"""Somebody who is farther from where the last speed leads, and brakes or turns harder, has had the
pose set anew."""
FASTEST_M_S = 40.0
"""The speed of whom no speed is known yet."""
TURN_RAD, FASTEST_RAD_S = math.radians(20.0), math.radians(180.0)
"""And who has turned more, and faster."""


@dataclass(frozen=True, slots=True)
class _Stood:
    time_s: float
    place: Floats
    """(2,) metres."""
    yaw: float
    velocity: Floats | None
    """(2,) m/s; None where only one pose is known."""


class Whereabouts:
    """Where somebody stood last, and how fast. For one thread."""

    def __init__(self) -> None:
        self._last: _Stood | None = None

    def jumps(self, time_s: float, world_from_own: Matrix) -> bool:
        """Takes a pose, and says whether it cannot be got to from the last one by driving. One of a
        time before that of the last one is passed over."""
        if self._last is not None and time_s < self._last.time_s:
            return False
        place, yaw = world_from_own[:2, 3].copy(), yaw_of(world_from_own)
        last, self._last = self._last, _Stood(time_s, place, yaw, None)
        if last is None:
            return False
        dt_s = time_s - last.time_s
        if last.velocity is None:
            off_m, most_m = place - last.place, JUMP_M + FASTEST_M_S * dt_s
        else:
            off_m = place - last.place - last.velocity * dt_s
            most_m = JUMP_M + 0.5 * HARDEST_M_S2 * dt_s**2
        turned = abs(math.remainder(yaw - last.yaw, math.tau))
        if np.hypot(*off_m) > most_m or turned > TURN_RAD + FASTEST_RAD_S * dt_s:
            return True
        velocity = (place - last.place) / dt_s if dt_s > 0.0 else last.velocity
        self._last = _Stood(time_s, place, yaw, velocity)
        return False

    def forget(self) -> None:
        """The next pose follows on nothing."""
        self._last = None
