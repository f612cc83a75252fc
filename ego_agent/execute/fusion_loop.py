"""Execute: carries out the decision in force, frame after frame, on threads of its own.

A frame: read the own newest scan, ask the chosen robots, fuse whatever arrived before the deadline,
publish. One thread asks, another one fuses, so that robots encode the next frame meanwhile. Frames
that the machine has no time for are skipped before anybody is asked, and counted, so that the loop
never falls behind the sensors.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from ego_agent.execute.ask import Asker
from ego_agent.execute.detections import detections
from ego_agent.execute.frame_fuser import FrameFuser, FrameResult
from ego_agent.execute.frame_round import Question
from ego_agent.execute.pipeline import AskedFrame, Pipeline
from ego_agent.execute.sense import OwnFrame, OwnSensor
from ego_agent.knowledge.pace import (
    about_places,
    algorithm_of,
    due,
    rate_of,
    sends_objects,
    stride,
)
from ego_agent.knowledge.tally import TallyKeeper
from ego_agent.monitor.known import KnownRobots
from perception.fusion.base import Fusion
from perception.fusion.compensation import MotionCompensation, OwnScan
from perception.fusion.mixed import Mixed
from perception.memory.asking import LONGEST_S, places_of
from perception.memory.memory import Remembered
from perception.memory.poses import PoseMemory
from perception.memory.reprocessing import ReprocessingMemory
from swarm import keyspace
from swarm.errors import TransportError
from swarm.log import Logger
from swarm.loop_watch import Loops, Turned, unwatched
from swarm.messages import MIXED, Algorithm, Decision
from swarm.session import Session

MAX_WAIT_S = 0.5
"""The loop looks at least this often whether it should stop, also when the clock was put back."""

MISSED = 10
"""Frames without a scan of their own whose robots are asked in the next one."""

TIMELY_SCANS = 1.1
"""Lag that a frame tolerates. Robots that share processors with the ego fall one scan behind when
these are busy, and another pass through the detector would make them busier."""


def live_motion(detector: str, scan_rate_hz: float, poses: PoseMemory | None) -> MotionCompensation:
    """What an ego with sensors of that rate remembers of motion; by what robots' poses are off is
    remembered in `poses`."""
    return MotionCompensation(detector, timely_s=TIMELY_SCANS / scan_rate_hz, poses=poses)


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
        detector: str,
        known: KnownRobots,
        memory: ReprocessingMemory | None = None,
        poses: PoseMemory | None = None,
        rate_hz: float,
        deadline_s: float,
        probe_after_s: float = 0.0,
        on_result: Callable[[FrameResult], None] | None = None,
        speaks: Callable[[], bool] = lambda: True,
    ) -> None:
        """`detector`: the world's. `known`: of whom beacons tell. `memory`: of objects.
        `poses`: the motion's; where it knows all errors, answers about places need no outline.
        `probe_after_s`: how old a decision is when its probe is sent. `on_result` hears of each
        published frame, on the fusing thread. `speaks`: whether detections are published."""
        self._ego = ego
        self._speaks = speaks
        self._sensor = sensor
        self._asker = asker
        self._fusions = fusions
        self._motion = motion
        self._poses = poses
        self._fuser = FrameFuser(
            ego,
            fusions,
            asker.knowledge,
            log,
            detector=detector,
            known=known,
            memory=memory,
            poses=poses,
        )
        self._tally = tally
        self._log = log
        self._rate_hz = rate_hz
        self._probed: Decision | None = None
        """The decision whose probe has been sent."""
        self._without_scan: deque[int] = deque(maxlen=MISSED)
        """Numbers of frames, among fused ones, that had no scan of their own."""
        self._deadline_s = deadline_s
        self._probe_after_s = probe_after_s
        self._followed_s = 0.0
        self._decision: Decision | None = None
        self._session: Session | None = None
        self._on_result = on_result
        self._pipeline = Pipeline()
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self.unpublished = 0
        """Detections that could not be published."""

    def start(self, loops: Loops = unwatched) -> None:
        """Starts the threads; frames begin with the first decision."""
        self._threads = [
            threading.Thread(target=run, args=(loops(name, 0.0),), name=name, daemon=True)
            for name, run in (("asking", self._ask_frames), ("fusion", self._fuse_frames))
        ]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Ends the threads after the frames that were asked for."""
        self._stop.set()
        self._asker.nudge()
        until = time.monotonic() + self._deadline_s + 5.0
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))

    def connect(self, session: Session) -> None:
        """From now on robots can be asked."""
        self._session = session

    @property
    def remembered(self) -> Remembered | None:
        """What was there at the newest fused frame; None without a memory. Any thread may ask."""
        return self._fuser.remembered

    def follow(self, decision: Decision | None) -> None:
        """The decision to carry out from the next frame on; None: there are no frames."""
        self._followed_s = time.monotonic()
        self._decision = decision

    def fuse(self, decision: Decision, own: OwnFrame) -> FrameResult:
        """Asks the decision's robots for the frame of `own` and fuses what came in time, all on
        the caller's thread; not while the loop runs."""
        frame = self._asked(decision, own)
        while frame.round.closed_at is None:
            self._asker.attend(MAX_WAIT_S)
        return self._fuser.fuse(frame, time.monotonic())

    def _ask_frames(self, turned: Turned) -> None:
        last: int | None = None
        captured_ns = -1
        while not self._stop.is_set():
            turned()
            decision = self._decision
            step = 1 if decision is None else stride(decision, self._sensor.rate_hz, self._rate_hz)
            newest = self._sensor.newest()
            frame = newest - newest % step
            # The first frame of a slower pace may lie before the last one of a faster.
            if decision is None or (last is not None and last - step < frame <= last):
                self._attend(self._sensor.until(frame + step))
                continue
            if (full_s := self._pipeline.full_for_s(time.monotonic())) > 0.0:
                self._attend(full_s)
                continue
            if last is not None and frame > last + step:
                self._tally.skipped((frame - last) // step - 1)
            last = frame
            try:
                own = self._sensor.read(frame)
                if own is None:
                    self._tally.failed()
                elif own.capture_ns == captured_ns:
                    # A sensor that is slower, or late: there is nothing new to fuse.
                    self._without_scan.append(frame // step)
                else:
                    captured_ns = own.capture_ns
                    self._pipeline.put(self._asked(decision, own))
            except Exception:
                self._failed(frame)
        while self._asker.waits:
            self._attend(MAX_WAIT_S)
        self._pipeline.close()

    def _attend(self, seconds: float) -> None:
        try:
            self._asker.attend(min(MAX_WAIT_S, max(0.001, seconds)))
        except Exception:
            # One answer must not end perception.
            self._log.error("answer_failed", exc_info=True)

    def _fuse_frames(self, turned: Turned) -> None:
        while (frame := self._pipeline.take(turned)) is not None:
            try:
                result = self._fuser.fuse(frame, time.monotonic())
                self._tally.fused(result.latency_ms, len(result.boxes), result.missing_kinds())
                self._publish(frame, result)
                if self._on_result is not None:
                    self._on_result(result)
                self._sensor.describe(frame.own)
            except Exception:
                self._failed(frame.own.frame)
            self._pipeline.done()
            self._asker.nudge()
            self._catch_up()

    def _catch_up(self) -> None:
        """Takes up what came late, where the next frame need not wait for that."""
        try:
            if self._pipeline.has_time(time.monotonic()):
                self._tally.caught_up(self._fuser.catch_up())
        except Exception:
            self._log.error("catching_up_failed", exc_info=True)

    def _failed(self, frame: int) -> None:
        # One bad frame must not end perception; the journal shows that it failed.
        self._tally.failed()
        self._log.error("frame_failed", frame=frame, exc_info=True)

    def _asked(self, decision: Decision, own: OwnFrame) -> AskedFrame:
        """Begins a frame and asks its robots."""
        numbers = self._numbers(decision, own)
        turns: dict[str, int] = {}
        for n in numbers:
            for robot in decision.participants:
                if robot != self._ego and robot not in turns and due(decision, robot, n):
                    turns[robot] = n
        forms = {robot: algorithm_of(decision, robot) for robot in turns}
        about = {
            robot: form
            for n in numbers
            for robot, form in self._about_places(decision, n).items()
            if robot not in forms
        }
        places = self._places(own) if about else b""
        if not places:
            about = {}
        algorithm, fusion = self._fusion_of(decision, [*forms.values(), *about.values()])
        scan = OwnScan(own.capture_ns * 1e-9, own.points, own.world_from_sensor)
        gathering = self._motion.begin(fusion, scan)
        self._probe(decision, own)
        tell = {
            form: gathering.ask_for(form)
            for form in dict.fromkeys([*forms.values(), *about.values()])
        }
        questions = {}
        # Without a memory of what is there nobody is asked about what is new.
        remembers = self._fuser.suspected is not None
        objects = {n: sends_objects(decision, n) for n in numbers} if remembers else {}
        for robot, form in forms.items():
            of_objects = robot in objects.get(turns[robot], ()) and self._fusions[form].focuses
            ask = replace(tell[form], objects_only=of_objects)
            rate_hz = rate_of(decision, robot)
            # Robots that contribute rarely take turns, in an order of this ego's own.
            shares = self._fusions[form].shareable and rate_hz >= decision.rate_hz
            questions[robot] = Question(form, ask, rate_hz, shares)
        # Whose pose is not known may have to be laid over what the others show.
        poses = self._poses
        known = poses is not None and all(
            poses.knows(robot, scan.time_s) for robot in (*forms, *about)
        )
        for robot, form in about.items():
            only = replace(tell[form], demand=places, without_outline=known)
            questions[robot] = Question(form, only, focused=True)
        done = self._asker.ask(
            self._session, questions, own.capture_ns, decision.deadline_s or self._deadline_s
        )
        return AskedFrame(decision, own, algorithm, fusion, gathering, done)

    def _numbers(self, decision: Decision, own: OwnFrame) -> tuple[int, ...]:
        """Whose turn it is in the frame of `own`: its number among fused frames, and before it
        those of frames that had no scan of their own."""
        number = own.frame // stride(decision, self._sensor.rate_hz, self._rate_hz)
        missed = [n for n in self._without_scan if number - MISSED <= n < number]
        self._without_scan.clear()
        return (*missed, number)

    def _places(self, own: OwnFrame) -> bytes:
        """Where something is remembered; empty where nothing is, or nothing is known of late."""
        known = self._fuser.suspected
        after_s = own.capture_ns * 1e-9 - known.time_s if known is not None else math.inf
        if known is None or not 0.0 < after_s <= LONGEST_S:
            return b""
        return places_of(known.tracks, after_s, own.world_from_sensor)

    def _about_places(self, decision: Decision, number: int) -> dict[str, Algorithm]:
        """Participants that are asked about places in the frame of that number, and what for: those
        whose whole contributions are fused, so that they stand where they say."""
        robots = about_places(decision.assignments, decision.rate_hz, number)
        forms = {r: algorithm_of(decision, r) for r in robots if r in self._fuser.whole}
        return {robot: form for robot, form in forms.items() if self._fusions[form].focuses}

    def _fusion_of(
        self, decision: Decision, forms: Collection[Algorithm]
    ) -> tuple[Algorithm, Fusion]:
        """What fuses a frame to which these forms are asked, and its name; with one form only, that
        form's own fusion."""
        if decision.algorithm != MIXED:
            return decision.algorithm, self._fusions[decision.algorithm]
        kinds = sorted({*forms}) or [one.algorithm for one in decision.assignments[:1]]
        if len(kinds) == 1:
            return kinds[0], self._fusions[kinds[0]]
        return MIXED, Mixed({form: self._fusions[form] for form in kinds})

    def _probe(self, decision: Decision, own: OwnFrame) -> None:
        """Asks the decision's question on the side, once: its answer teaches, and is not fused."""
        probe = decision.probe
        waited_s = time.monotonic() - self._followed_s
        if probe is None or decision is self._probed or waited_s < self._probe_after_s:
            return
        self._probed = decision
        asked = algorithm_of(decision, probe.robot)
        if probe.algorithm == asked and probe.robot in decision.participants:
            return  # It is asked for that anyway by now.
        tell = self._fusions[probe.algorithm].begin(own.points, own.world_from_sensor).ask()
        self._asker.ask(
            self._session,
            {probe.robot: Question(probe.algorithm, tell, decision.rate_hz)},
            own.capture_ns,
            decision.deadline_s or self._deadline_s,
            probe=True,
        )

    def _publish(self, frame: AskedFrame, result: FrameResult) -> None:
        if not self._speaks():
            return
        age_s = self._sensor.age_s(result.own)
        session, message = self._session, detections(self._ego, frame, result, age_s)
        try:
            if session is None:
                raise TransportError("no router yet")
            session.put(keyspace.detections(session.swarm, self._ego), message)
        except TransportError:
            self.unpublished += 1
