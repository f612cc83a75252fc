"""Where robots are at a frame's time, as their fresh beacons tell."""

from __future__ import annotations

from dataclasses import replace

from ego_agent.monitor.snapshot import Monitor
from perception.fusion.known import KnownRobot
from swarm.body import Body
from swarm.messages import Beacon


class KnownRobots:
    """All robots but the ego; safe to use from any thread."""

    def __init__(self, monitor: Monitor, max_age_s: float, usual_body: Body) -> None:
        """`max_age_s`: an older beacon tells nothing. `usual_body`: of robots that announce
        none."""
        self._monitor = monitor
        self._max_age_s = max_age_s
        self._usual_body = usual_body

    def at(self, capture_ns: int) -> tuple[KnownRobot, ...]:
        """In the world frame, at a time of the ego's clock; each moved there by its velocity."""
        found = []
        for beacon, offset_ns in self._monitor.beacons():
            ahead_s = (capture_ns + offset_ns - beacon.capture_ns) * 1e-9
            if abs(ahead_s) <= self._max_age_s:
                found.append(self._moved(beacon, ahead_s))
        return tuple(found)

    def _moved(self, beacon: Beacon, ahead_s: float) -> KnownRobot:
        told, (x, y, z) = beacon.sensor_pose(), beacon.velocity
        here = replace(told, x=told.x + x * ahead_s, y=told.y + y * ahead_s, z=told.z + z * ahead_s)
        body = beacon.body or self._usual_body
        return KnownRobot(beacon.robot, body, here.matrix(), abs(ahead_s), (x, y))
