"""What answers teach: how long each robot takes for each algorithm, and what its link carries."""

from __future__ import annotations

import math

from ego_agent.execute.frame_round import FrameRound, Missing
from ego_agent.knowledge.experience import Experience, frames_of
from ego_agent.monitor.evidence import Queues
from ego_agent.monitor.link import LinkEstimate
from swarm.errors import CoAdaptError
from swarm.messages import Observation
from swarm.session import Answer

PROBE_FRAMES = 10.0
"""Frames that the answer to a probe counts for: there are few of them, and two that come in time
outweigh what was late while a queue drained (`MEMORY_FRAMES`)."""


class Lessons:
    """Notes how requests ended. Used by the asking thread only."""

    def __init__(self, experience: Experience, link: LinkEstimate, frames_hz: float) -> None:
        """`frames_hz`: of the sensors."""
        self._experience = experience
        self._link = link
        self._frames_hz = frames_hz
        self._queues = Queues()

    def answer(
        self,
        robot: str,
        done: FrameRound,
        outcome: Answer[Observation] | CoAdaptError,
        at: float,
        wrong: Missing | None = None,
    ) -> None:
        """An answer, or why there is none, `time.monotonic()` seconds; also one that is late.
        `wrong`: why it is not what was asked for. One that shows another moment brings no more than
        none; of one that is not the robot's own nothing is believed."""
        answer_s = at - done.asked_at[robot]
        # Until the deadline it was waited for already.
        more_s = answer_s if robot in done.waiting else answer_s - done.deadline_s
        if not isinstance(outcome, Answer) or (wrong is not None and wrong.kind != "skew"):
            self._note(done, robot, math.inf, more_s)
            return
        seen = outcome.message
        work_ms = seen.work_ms or seen.encode_ms
        came_s = answer_s if wrong is None else math.inf
        self._note(done, robot, came_s, more_s, seen.encode_ms * 1e-3, work_ms * 1e-3)
        self.link(robot, outcome, at, wrong)

    def link(
        self,
        robot: str,
        outcome: Answer[Observation] | CoAdaptError,
        at: float,
        wrong: Missing | None = None,
    ) -> None:
        """What the robot's kernel says of its own link with an answer; see `answer`."""
        if not isinstance(outcome, Answer) or (wrong is not None and wrong.kind != "skew"):
            return
        seen = outcome.message
        shown = self._queues.take((robot, seen.instance), seen.uplink)
        if shown is not None:
            self._link.add_robot(robot, shown, at)

    def silence(self, done: FrameRound, robot: str) -> None:
        """The deadline has passed: not how long it takes, but that it takes longer, is known."""
        longer_s = math.nextafter(done.deadline_s, math.inf)
        self._note(done, robot, longer_s, done.deadline_s, at_least=True)

    def _note(
        self,
        done: FrameRound,
        robot: str,
        answer_s: float,
        more_s: float,
        encode_s: float | None = None,
        work_s: float | None = None,
        *,
        at_least: bool = False,
    ) -> None:
        """All frames of the time `more_s` that it kept the robot busy count."""
        question = done.questions[robot]
        frames = frames_of(more_s, question.rate_hz, self._frames_hz)
        self._experience.record(
            robot,
            question.algorithm,
            answer_s,
            frames=PROBE_FRAMES if done.probe else frames,
            encode_s=encode_s,
            work_s=work_s,
            capacity_bps=done.capacity_bps,
            at_least=at_least,
            asked_s=done.asked_at[robot],
            deadline_s=done.deadline_s,
        )
