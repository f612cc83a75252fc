"""The interface of a fusion algorithm: what a robot sends, and how the ego fuses it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from perception.types import Boxes
from swarm.geometry import Matrix, Points


@dataclass(frozen=True, slots=True)
class EncodeOptions:
    """What the ego asks of the robot's encoder."""

    max_error_m: float = 0.1
    """Bound on the Euclidean error of any coded point."""
    keep_ground: bool = False


@dataclass(frozen=True, slots=True)
class Contribution:
    """A payload as it arrived, with the sender's sensor pose at capture."""

    robot: str
    payload: bytes
    world_from_sensor: Matrix


@dataclass(frozen=True, slots=True)
class FusionResult:
    """Fused boxes in the world frame, and the robots whose payload could not be used, with why."""

    boxes: Boxes
    rejected: dict[str, str]


class Fusion(Protocol):
    """A fusion algorithm; instances hold no state between frames."""

    name: str

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """Robot side: a scan, float32 (N, 3) in the sensor's frame, as a payload."""
        ...

    def fuse(
        self, own: Points, world_from_own: Matrix, contributions: Sequence[Contribution]
    ) -> FusionResult:
        """Ego side: own scan (sensor frame) and contributions to boxes in the world frame.

        A contribution that cannot be read is left out and named in `rejected`.
        """
        ...
