"""Which robots the ego keeps records of: those that are there, and no more than there is room for.

Names come from the network; one that is made up must not take the room of a robot.
"""

from __future__ import annotations

import math

from ego_agent.monitor.robot_record import RobotRecord

MAX_ROBOTS = 1024
"""Of which the newest messages are kept: several times what is ever in range. Names come from the
network, and one that is made up takes as much memory as the largest scene that a router passes."""
MAX_TOKENS = 100_000
"""Of robots that have no beacon: names cost little, a robot's record more."""
FORGET_S = 30.0
"""A robot that has left and was silent this long makes room for another."""


class RobotTable:
    """Records by robot id, the ego's among them. Not thread-safe."""

    def __init__(self, ego: str, max_robots: int, *, nearby: bool) -> None:
        """`nearby`: only robots near the ego are listened to."""
        self._ego = ego
        self._max_robots = max_robots
        self._nearby = nearby
        self._tokens: set[str] = set()
        """Robots whose liveliness token is there."""
        self.known: dict[str, RobotRecord] = {ego: RobotRecord(alive=True)}
        self.no_room = 0
        """Messages of robots for which there was no room."""

    def join(self, robot: str, now: float) -> None:
        """A liveliness token appeared."""
        if len(self._tokens) < MAX_TOKENS:
            self._tokens.add(robot)
        if self._nearby and robot not in self.known:
            return  # It is somewhere on the site, and shows itself where it comes near.
        record = self._record(robot, now)
        if record is not None:
            record.alive = True

    def leave(self, robot: str) -> None:
        """A liveliness token is gone. Whether the ego is alive, it knows better itself."""
        self._tokens.discard(robot)
        if robot in self.known and robot != self._ego:
            self.known[robot].alive = False

    def speaks(self, robot: str, now: float) -> RobotRecord | None:
        """The record of a robot that speaks, new if there is room; None where there is none. A
        robot whose token is there takes the room of one that has none or never spoke."""
        return self._record(robot, now, speaks=True)

    def alive(self) -> int:
        """How many are alive."""
        return sum(record.alive for record in self.known.values())

    def forget(self, now: float) -> None:
        """Drops the robots that have left and are silent; where only those nearby are listened to,
        also those that are silent: they are somewhere else."""
        for robot in [
            robot
            for robot, record in self.known.items()
            if robot != self._ego
            and (self._nearby or not record.alive)
            and now - record.heard_at > FORGET_S
        ]:
            del self.known[robot]

    def _record(self, robot: str, now: float, *, speaks: bool = False) -> RobotRecord | None:
        record = self.known.get(robot)
        if record is None:
            if len(self.known) >= self._max_robots:
                self.forget(now)
            if len(self.known) >= self._max_robots and speaks and robot in self._tokens:
                self._displace()
            if len(self.known) >= self._max_robots:
                self.no_room += 1
                return None
            record = self.known[robot] = RobotRecord(alive=robot in self._tokens)
        return record

    def _displace(self) -> None:
        """Drops a robot that has never spoken, or whose token is not there, if there is one."""
        doubtful = (
            robot
            for robot, record in self.known.items()
            if robot != self._ego and (record.heard_at == -math.inf or not record.alive)
        )
        loser = next(doubtful, None)
        if loser is not None:
            del self.known[loser]
