"""What the ego senses itself: it counts before anything that is heard under the ego's id."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from ego_agent.knowledge.model import RobotView
from swarm.messages import Beacon, SceneDescription


@dataclass(slots=True)
class OwnSenses:
    """The newest of it. Times are seconds of the ego's steady clock."""

    beacon: Beacon | None = None
    beacon_at: float = float("-inf")
    scene: SceneDescription | None = None
    scene_at: float = float("-inf")
    off_duty: str = ""
    """Who keeps the ego's own robot out of the swarm; empty: nobody does."""

    def take(self, beacon: Beacon, scene: SceneDescription | None, now: float) -> None:
        """Takes what was sensed; None: no new scene."""
        self.beacon, self.beacon_at = beacon, now
        if scene is not None:
            self.scene, self.scene_at = scene, now

    def view(self, ego: str, heard: Beacon | None, now: float, wall_ns: int) -> RobotView:
        """The ego as it senses itself. An impostor under its id cannot harm it: nothing of what
        the ego knows about itself comes over the link but what its own payloads would cost, which
        the last beacon that was `heard` says."""
        beacon = self.beacon
        if beacon is not None and heard is not None:
            beacon = msgspec.structs.replace(beacon, sizes=heard.sizes)
        return RobotView(
            robot=ego,
            alive=True,
            beacon=beacon,
            beacon_age_s=_age_s(beacon, now - self.beacon_at, wall_ns),
            scene=self.scene,
            scene_age_s=_age_s(self.scene, now - self.scene_at, wall_ns),
            round_trip_s=0.0,
            clock_offset_s=0.0,
            duplicate=False,
            off_duty=self.off_duty,
        )


def _age_s(sensed: Beacon | SceneDescription | None, told_ago_s: float, wall_ns: int) -> float:
    """Of what was sensed; infinite where there is nothing."""
    if sensed is None:
        return math.inf
    return max(told_ago_s, (wall_ns - sensed.capture_ns) * 1e-9)
