"""Whether an answer is what was asked for, and what it brings to a frame."""

from __future__ import annotations

from ego_agent.execute.frame_round import FrameRound, Missing
from ego_agent.monitor.snapshot import Monitor
from perception.fusion.base import Contribution
from swarm.errors import CoAdaptError, MessageError, RefusedError
from swarm.messages import Observation, ObservationRequest
from swarm.session import Answer

MAX_SKEW_FRAMES = 1.5
"""An answer farther off than this many frame periods shows another moment: a robot that reads its
scan a little later than the ego gives the frame before."""

Outcome = Answer[Observation] | CoAdaptError
"""How a request ends."""


class AnswerCheck:
    """Holds what comes against what was asked for, and against who sends the robot's beacons."""

    def __init__(self, monitor: Monitor, frame_period_s: float) -> None:
        self._monitor = monitor
        self.max_skew_ns = round(MAX_SKEW_FRAMES * frame_period_s * 1e9)

    def answer(self, robot: str, asked: ObservationRequest, seen: Observation) -> Missing | None:
        """Why an answer is not what the robot was asked for; None where it is."""
        if (seen.robot, seen.request, seen.algorithm) != (robot, asked.request, asked.algorithm):
            return Missing(
                "invalid",
                f"answer {seen.request} of {seen.robot} ({seen.algorithm}) to request "
                f"{asked.request} to {robot} ({asked.algorithm})",
            )
        return self.frame(robot, asked.capture_ns, seen)

    def frame(self, robot: str, wanted_ns: int, seen: Observation) -> Missing | None:
        """Why a frame is not the robot's own of that time on its clock; None where it is."""
        instance = self._monitor.instance(robot)
        if instance is not None and seen.instance != instance:
            why = f"not the process that sends the beacons of {robot} answers"
            return Missing("impostor", why)
        skew_ns = seen.capture_ns - wanted_ns
        if abs(skew_ns) > self.max_skew_ns:
            return Missing("skew", f"its frame is {skew_ns * 1e-9:+.3f} s off")
        return None


def brings(outcome: Outcome) -> bool:
    """Whether an answer holds what was asked for."""
    return isinstance(outcome, Answer) and bool(outcome.message.payload)


def contribute(done: FrameRound, wanted_ns: int, seen: Observation) -> None:
    """Gives a robot's frame to the round that waits for it."""
    done.bytes[seen.robot] = len(seen.payload)
    done.encode_ms[seen.robot] = seen.encode_ms
    done.take(contribution(done, wanted_ns, seen))


def contribution(done: FrameRound, wanted_ns: int, seen: Observation) -> Contribution:
    """A robot's frame as the fusion of a round takes it."""
    age_s = (wanted_ns - seen.capture_ns) * 1e-9
    form = seen.algorithm if done.is_mixed else ""
    return Contribution(seen.robot, seen.payload, seen.sensor_pose().matrix(), age_s, form)


def why_missing(error: CoAdaptError) -> Missing:
    """Why a robot that did not answer is not in the frame."""
    if isinstance(error, RefusedError):
        return Missing("refused", error.reason)
    return Missing("invalid" if isinstance(error, MessageError) else "unanswered", str(error))
