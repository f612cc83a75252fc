"""Execute: carries out the decision in force, frame after frame, on a thread of its own.

A frame: read the own newest scan, ask the chosen robots, fuse whatever arrived before the deadline,
publish. Frames that the machine has no time for are skipped and counted, so that the loop never
falls behind the sensors.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ego_agent.ask import Asker, FrameRound, kind_of
from ego_agent.sense import OwnFrame, OwnSensor
from ego_agent.tally import TallyKeeper
from perception.fusion.base import Contribution, Fusion
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.types import Boxes
from swarm import keyspace
from swarm.arrays import pack
from swarm.errors import PerceptionError, TransportError
from swarm.log import Logger
from swarm.messages import Decision, Detections
from swarm.session import Session

MAX_WAIT_S = 0.5
"""The loop looks at least this often whether it should stop, also when the clock was put back."""

TIMELY_SCANS = 1.1
"""Lag that a frame tolerates. Robots that share processors with the ego fall one scan behind when
these are busy, and another pass through the detector would make them busier."""


def live_motion(detector: str, scan_rate_hz: float) -> MotionCompensation:
    """What an ego with sensors of that rate remembers of motion."""
    return MotionCompensation(detector, timely_s=TIMELY_SCANS / scan_rate_hz)


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One fused frame."""

    own: OwnFrame
    round: FrameRound
    boxes: Boxes
    participants: tuple[str, ...]
    missing: Mapping[str, str]
    latency_ms: float
    """From the first query to the fused boxes."""
    fuse_ms: float
    """From the last answer to the fused boxes."""


class FusionLoop:
    """Fuses the newest frame at the fusion rate until stopped."""

    def __init__(
        self,
        ego: str,
        sensor: OwnSensor,
        asker: Asker,
        fusions: Mapping[str, Fusion],
        motion: MotionCompensation,
        tally: TallyKeeper,
        log: Logger,
        *,
        rate_hz: float,
        deadline_s: float,
    ) -> None:
        self._ego = ego
        self._sensor = sensor
        self._asker = asker
        self._fusions = fusions
        self._motion = motion
        self._tally = tally
        self._log = log
        self._stride = max(1, round(sensor.rate_hz / rate_hz))
        self._deadline_s = deadline_s
        self._decision: Decision | None = None
        self._session: Session | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fusion", daemon=True)
        self.unpublished = 0
        """Detections that could not be published."""

    def start(self) -> None:
        """Starts the thread; frames begin with the first decision."""
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread after the frame in hand."""
        self._stop.set()
        self._thread.join(self._deadline_s + 5.0)

    def connect(self, session: Session) -> None:
        """From now on robots can be asked."""
        self._session = session

    def follow(self, decision: Decision) -> None:
        """The decision to carry out from the next frame on."""
        self._decision = decision

    def _run(self) -> None:
        last: int | None = None
        while not self._stop.is_set():
            newest = self._sensor.newest()
            frame = newest - newest % self._stride
            decision = self._decision
            if decision is None or frame == last:
                wait_s = self._sensor.until(frame + self._stride)
                self._asker.wait(min(MAX_WAIT_S, max(0.001, wait_s)))
                continue
            if last is not None and frame > last + self._stride:
                self._tally.skipped((frame - last) // self._stride - 1)
            last = frame
            try:
                self._frame(decision, frame)
            except Exception:
                # One bad frame must not end perception; the journal shows that it failed.
                self._tally.failed()
                self._log.error("frame_failed", frame=frame, exc_info=True)

    def _frame(self, decision: Decision, frame: int) -> None:
        own = self._sensor.read(frame)
        if own is None:
            self._tally.failed()
            return
        result = self.fuse(decision, own)
        kinds = {robot: kind_of(reason) for robot, reason in result.missing.items()}
        self._tally.fused(result.latency_ms, len(result.boxes), kinds)
        self._publish(decision, result)
        self._sensor.describe(own)

    def fuse(self, decision: Decision, own: OwnFrame) -> FrameResult:
        """Asks the decision's robots for the frame of `own` and fuses what came in time."""
        session = self._session
        others = tuple(robot for robot in decision.participants if robot != self._ego)
        fusion = self._fusions[decision.algorithm]
        scan = OwnScan(own.capture_ns * 1e-9, own.points, own.world_from_sensor)
        gathering = self._motion.begin(fusion, scan)
        done = self._asker.ask(
            session,
            others,
            decision.algorithm,
            own.capture_ns,
            self._deadline_s,
            gathering.ask(),
        )
        gathering.prepare()
        rejected: dict[str, str] = {}

        def take_up(contribution: Contribution) -> None:
            # One robot's payload must not end the frame, whatever is wrong with it.
            try:
                gathering.add(contribution)
            except Exception as error:
                rejected[contribution.robot] = self._fault(error, own)

        self._asker.collect(session, done, take_up)
        fuse_at = time.monotonic()
        try:
            boxes = gathering.finish()
        except Exception as error:
            if not done.contributions:
                raise
            why = self._fault(error, own)
            rejected = {c.robot: why for c in done.contributions}
            boxes = fusion.begin(own.points, own.world_from_sensor).finish()
        end_at = time.monotonic()
        missing = dict(done.missing)
        missing.update({robot: f"rejected: {why}" for robot, why in rejected.items()})
        used = tuple(c.robot for c in done.contributions if c.robot not in rejected)
        return FrameResult(
            own=own,
            round=done,
            boxes=boxes,
            participants=(self._ego, *sorted(used)),
            missing=missing,
            latency_ms=(end_at - done.begun_at) * 1e3,
            fuse_ms=(end_at - fuse_at) * 1e3,
        )

    def _fault(self, error: Exception, own: OwnFrame) -> str:
        """Why a contribution is rejected; a fault that is not the payload's is logged."""
        if isinstance(error, PerceptionError):
            return str(error)
        self._log.error("fusion_failed", frame=own.frame, exc_info=True)
        return f"fusion failed: {type(error).__name__}"

    def _publish(self, decision: Decision, result: FrameResult) -> None:
        session, boxes = self._session, result.boxes
        table = np.column_stack([boxes.centers, boxes.sizes, boxes.headings]).astype(np.float32)
        message = Detections(
            ego=self._ego,
            cycle=decision.cycle,
            frame=result.own.frame,
            capture_ns=result.own.capture_ns,
            algorithm=decision.algorithm,
            participants=result.participants,
            missing=dict(result.missing),
            boxes=pack(table),
            scores=pack(boxes.scores.astype(np.float32).reshape(-1, 1)),
            labels=boxes.labels,
            bytes=result.round.bytes,
            latency_ms=result.latency_ms,
        )
        try:
            if session is None:
                raise TransportError("no router yet")
            session.put(keyspace.detections(session.swarm, self._ego), message)
        except TransportError:
            self.unpublished += 1
