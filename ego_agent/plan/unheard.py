"""Asking robots that are not heard: one of them for one frame, on the side.

Beacons queue before a link that has become narrow, while observations, which have a link of their
own, pass them: an answer shows where its robot is (`Monitor.note_answer`), and it may take part
again. Without it an ego is blind until the queue has drained.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Snapshot
from ego_agent.plan.control_budget import beacons_stand
from ego_agent.plan.intents.bind import left_out
from ego_agent.plan.intents.combine import Standing
from ego_agent.plan.probe import spare_bps
from swarm.messages import Decision, Probe

FIRST_S, LAST_S = 1.0, 60.0
"""Time from one question to the same robot to the next: it doubles until it is chosen."""
FORGET_S = 120.0
"""A robot that has not been asked for so long is asked as at first."""


@dataclass(slots=True)
class _LastProbe:
    at_s: float
    wait_s: float


class UnheardProber:
    """Says in each cycle which robot to ask, if any. Times are `time.monotonic()` seconds."""

    def __init__(self) -> None:
        self._asked: dict[str, _LastProbe] = {}

    def take(
        self,
        snapshot: Snapshot,
        knowledge: Knowledge,
        decision: Decision,
        wishes: Standing,
        now_s: float,
    ) -> Probe | None:
        """What the decision after this one shall ask: the nearest robot whose turn it is, of those
        that are out only because what is known of them is too old, for its smallest observation.
        None where there is nobody, where beacons of others come quickly, so that the rest will come
        by themselves, or where the link does not carry the answer within a second. Whom intents
        leave out is left alone."""
        for robot, last in list(self._asked.items()):
            if robot in decision.participants or now_s - last.at_s > FORGET_S:
                del self._asked[robot]
        if not beacons_stand(snapshot):
            return None
        free_bps = spare_bps(knowledge.objective, snapshot.capacity_bps, decision)
        able = [
            (distance_m, robot, probe)
            for distance_m, robot, probe in _too_old(snapshot, knowledge)
            if 8.0 * probe.bytes <= free_bps
            and self._is_due(robot, now_s)
            and not left_out(robot, wishes)
        ]
        if not able:
            return None
        _, robot, probe = min(able, key=lambda one: one[:2])
        before = self._asked.get(robot)
        wait_s = FIRST_S if before is None else min(LAST_S, 2.0 * before.wait_s)
        self._asked[robot] = _LastProbe(now_s, wait_s)
        return probe

    def _is_due(self, robot: str, now_s: float) -> bool:
        last = self._asked.get(robot)
        return last is None or now_s - last.at_s >= last.wait_s


def _too_old(snapshot: Snapshot, knowledge: Knowledge) -> Iterator[tuple[float, str, Probe]]:
    """Robots in range that the age of what is known keeps out, and nothing else: how far they were,
    metres, and the cheapest question to them."""
    ego = snapshot.robots.get(snapshot.ego)
    if ego is None or ego.beacon is None:
        return
    here, objective = ego.beacon.sensor_pose(), knowledge.objective
    for robot, view in snapshot.robots.items():
        if robot == snapshot.ego or view.beacon is None or not view.alive:
            continue
        if view.duplicate or view.misfit or view.beacon_age_s <= objective.beacon_max_age_s:
            continue
        distance_m = view.beacon.sensor_pose().distance_to(here)
        sizes = knowledge.payload_sizes(robot, view.beacon.sizes, snapshot.now_ns)
        if sizes and distance_m <= objective.comm_range_m:
            size, algorithm = min((size, algorithm) for algorithm, size in sizes.items())
            yield distance_m, robot, Probe(robot=robot, algorithm=algorithm, bytes=size)
