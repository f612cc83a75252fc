"""Probing the way back: one robot is asked for one frame of what the ego would rather have.

Without it, a decision that was given up because nothing came would only be tried again when it is
half forgotten, by everybody at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import algorithm_of
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.policies.coverage import Coverage
from swarm.messages import Decision, Probe

FIRST_S, LAST_S = 5.0, 60.0
"""Time from one probe to the next: it doubles with every failure."""
FORGET_S = 60.0
"""When nothing has been missed for so long, the next probe is a first one."""
DOUBTED = 0.9
"""Who is expected to be in time more often than this is not probed."""


@dataclass(frozen=True, slots=True)
class _Sent:
    """A probe whose end is not known yet."""

    probe: Probe
    at_s: float
    deadline_s: float


class Prober:
    """Says in each cycle whether to probe. Times are `time.monotonic()` seconds."""

    def __init__(self) -> None:
        self._wait_s = FIRST_S
        self._due_s: float | None = None
        self._missed_s = float("-inf")
        self._sent: _Sent | None = None

    def take(
        self, scene: UnifiedScene, knowledge: Knowledge, decision: Decision, now_s: float
    ) -> Probe | None:
        """The probe that the decision after this one shall carry, if one is due and the link
        carries it."""
        if not knowledge.learns:
            return None
        self._hear(knowledge, now_s)
        if not any(candidate.answers for candidate in scene.candidates):
            return None
        if self._due_s is None:
            self._due_s = now_s + self._wait_s
        if self._sent is not None or now_s < self._due_s:
            return None
        hoping = Scorer(scene, knowledge, hopes=True)
        # However new the decision is: a probe changes nothing yet.
        hoped, _ = Coverage().choose(hoping, msgspec.structs.replace(decision, held_s=None))
        probe = _of(Scorer(scene, knowledge).at(hoped.pace), hoped, decision)
        if probe is None:
            self._due_s = now_s + FIRST_S
            if now_s - self._missed_s > FORGET_S:
                self._wait_s = FIRST_S
            return None
        self._missed_s = now_s
        self._sent = _Sent(probe, now_s, hoped.pace.deadline_s)
        return probe

    def _hear(self, knowledge: Knowledge, now_s: float) -> None:
        """What came of the last probe; one that nobody has heard of for FIRST_S was never sent, or
        its end is explained by the link."""
        sent = self._sent
        if sent is None:
            return
        told = knowledge.experience.last(sent.probe.robot, sent.probe.algorithm)
        if told is None or told.at_s < sent.at_s:
            if now_s - sent.at_s >= FIRST_S:
                self._sent, self._due_s = None, now_s
            return
        # What is only known to take longer than some time has not come.
        came = not told.at_least and told.answer_s <= sent.deadline_s
        self._sent = None
        # After a success the next robot is asked at once.
        self._due_s = now_s if came else now_s + self._wait_s
        if not came:
            self._wait_s = min(LAST_S, 2.0 * self._wait_s)


def spare_bps(objective: Objective, capacity_bps: float, decision: Decision) -> float:
    """What a decision leaves of its share of C(t), bit/s."""
    return objective.headroom * capacity_bps - 8.0 * decision.cost_bytes * decision.rate_hz


def _of(scorer: Scorer, hoped: Score, decision: Decision) -> Probe | None:
    """The hoped-for participant to ask: of those that are doubted and not asked for the same
    anyway, the one that is doubted least, so that one who came in time is soon believed. None where
    nobody is, or where the link does not carry the answer within a second."""
    asked = {robot: algorithm_of(decision, robot) for robot in decision.participants}
    free_bps = spare_bps(scorer.objective, scorer.scene.capacity_bps, decision)
    able = []
    for robot in hoped.participants:
        algorithm = hoped.algorithm_of(robot)
        size, chance = scorer.size(robot, algorithm), scorer.in_time(robot, algorithm)
        if asked.get(robot) != algorithm and 8.0 * size <= free_bps and chance < DOUBTED:
            able.append((-chance, robot, Probe(robot=robot, algorithm=algorithm, bytes=size)))
    return min(able, key=lambda one: one[:2])[2] if able else None
