"""One robot: what it senses, tells the swarm, and answers."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import msgspec

from perception.fusion.base import EncodeOptions
from robot_agent.encoder import Encoder
from robot_agent.frames import Frame, Ring
from robot_agent.metrics import RobotMetrics
from robot_agent.sensor import Sensor
from robot_agent.sharing import Sharing
from robot_agent.sizes import Sizes
from robot_agent.stopwatch import Stopwatch
from sensing.telling import Teller
from swarm.errors import CoAdaptError, PerceptionError
from swarm.log import Logger
from swarm.messages import Beacon, Observation, ObservationRequest, SceneDescription
from swarm.process import Clock
from worlds.base import World

MAX_GAP_S = 0.25
"""A frame farther than this from the time asked for is no answer: at 2 m/s it is 0.5 m off."""


class RobotAgent:
    """One robot without its network: every method gives a message or changes the robot.

    `sense`, `describe`, `beacon`, `observe` and `share` may run on threads of their own.
    """

    def __init__(
        self,
        world: World,
        robot: str,
        *,
        instance: int,
        epoch_ns: int,
        encoder: Encoder,
        clock: Clock,
        metrics: RobotMetrics,
        log: Logger,
        ring_frames: int = 10,
        size_period_s: float = 20.0,
        mark: str = "",
    ) -> None:
        """`size_period_s`: how old an announced size may be. `mark`: of the robot's world."""
        self.robot = robot
        self._teller = Teller(world, robot, instance, clock.now_ns, mark)
        self._encoder = encoder
        self._clock = clock
        self._metrics = metrics
        self._log = log.bind(robot=robot)
        self._ring = Ring(ring_frames)
        self.sensor = Sensor(
            world,
            robot,
            self._ring,
            epoch_ns=epoch_ns,
            clock=clock,
            metrics=metrics,
            log=self._log,
        )
        self._sharing = Sharing(encoder.shareable, world.rate_hz)
        self._shared: Frame | None = None
        """The newest frame that was looked at for those who share it."""
        self._sizes = Sizes(world.detector, encoder.algorithms, size_period_s)
        self._options = EncodeOptions()
        self._answering = 0
        """Answers that are being encoded."""
        self._lock = threading.Lock()
        self._described: Frame | None = None

    def now_ns(self) -> int:
        """The time on the robot's clock."""
        return self._clock.now_ns()

    def rest(self) -> None:
        """Forgets what it has seen; `beacon` and `describe` give None until it senses again."""
        self.sensor.rest()
        self._ring.clear()

    def beacon(self) -> Beacon | None:
        """The robot's state at its newest frame; None before the first."""
        frame = self._ring.newest()
        if frame is None:
            return None
        beacon = self._teller.beacon(
            frame.number,
            frame.capture_ns,
            frame.scan.pose,
            frame.scan.velocity,
            self._sizes.known(),
            steady_ns=time.monotonic_ns(),
        )
        shared = self._sharing.published_now(time.monotonic())
        return msgspec.structs.replace(beacon, shared=shared) if shared else beacon

    def describe(self) -> SceneDescription | None:
        """The newest frame's scene, None when it was described already.

        Raises PerceptionError when the scan cannot be described.
        """
        frame = self._ring.newest()
        if frame is None or frame is self._described:
            return None
        self._described = frame
        scan = frame.scan
        scene = self._teller.description(frame.number, frame.capture_ns, scan.pose, scan.points)
        self._metrics.scene_seconds.observe(scene.elapsed_ms * 1e-3)
        return scene

    def measure(self) -> None:
        """Encodes the newest frame for one algorithm whose announced size is too old, if there is
        one, in the form that was last asked for.

        Answers tell the sizes of what is in use, so that only the rest is encoded for its size
        alone, and never while an answer is encoded. An algorithm whose encoder fails has no size
        until it works again.
        """
        frame, now = self._ring.newest(), time.monotonic()
        algorithm = self._sizes.overdue(now)
        if frame is None or algorithm is None or self._answering:
            return
        try:
            options = replace(self._options, pose=frame.scan.pose)
            payload, _ = self._encoder.encode(frame, algorithm, options)
        except PerceptionError as error:
            self._sizes.forget(algorithm, now)
            self._log.warning("encode_failed", algorithm=algorithm, error=str(error)[:300])
        else:
            self._note_size(algorithm, payload)

    def observe(self, request: ObservationRequest) -> Observation:
        """Answers a request for one frame in one form.

        Raises PerceptionError, whose text tells the asker why, when there is no frame near the
        time asked for, the algorithm does not exist, or the payload is larger than asked for.
        """
        watch = Stopwatch()
        shared_s = self._sharing.asked(request, time.monotonic())
        self._options = EncodeOptions(request.max_error_m, request.keep_ground)
        frame = self._frame_for(request)
        if shared_s and request.listens:
            self._count(request, "shared")
            return self._observation(
                frame, request.algorithm, b"", request=request.request, shared_s=shared_s
            )
        options = replace(
            self._options,
            pose=frame.scan.pose,
            reference=request.reference_pose(),
            demand=request.demand,
            without_outline=request.without_outline,
            objects_only=request.objects_only,
        )
        try:
            with self._answers():
                payload, work_ms = self._encoder.encode(frame, request.algorithm, options)
        except CoAdaptError:
            self._count(request, "failed")
            raise
        part = request.demand or request.objects_only
        if not (part and self._encoder.focuses(request.algorithm)):
            # A part tells nothing of what everything takes.
            self._note_size(request.algorithm, payload)
            self._sharing.answered(request.algorithm, len(payload))
        if len(payload) > request.max_bytes:
            self._count(request, "too_large")
            raise PerceptionError(
                f"{request.algorithm} payload of frame {frame.number} has {len(payload)} "
                f"bytes, at most {request.max_bytes} were asked for"
            )
        self._count(request, "sent")
        self._metrics.sent_bytes.labels(self.robot, request.algorithm).inc(len(payload))
        return self._observation(
            frame,
            request.algorithm,
            payload,
            request=request.request,
            shared_s=shared_s,
            encode_ms=watch.passed_ms(),
            work_ms=work_ms,
        )

    def share(self) -> list[Observation]:
        """What is to be published of the newest frame for several egos; nothing the second time.

        Raises PerceptionError when the scan cannot be encoded; egos are answered one by one then.
        """
        frame, now = self._ring.newest(), time.monotonic()
        if frame is None or frame is self._shared:
            return []
        self._shared = frame
        found = []
        for algorithm, form in self._sharing.due(frame.number, now):
            watch = Stopwatch()
            with self._answers():
                options = replace(form, pose=frame.scan.pose)
                payload, work_ms = self._encoder.encode(frame, algorithm, options)
            if not self._sharing.published(algorithm, len(payload), now):
                continue
            self._note_size(algorithm, payload)
            self._metrics.sent_bytes.labels(self.robot, algorithm).inc(len(payload))
            found.append(
                self._observation(
                    frame, algorithm, payload, encode_ms=watch.passed_ms(), work_ms=work_ms
                )
            )
        return found

    def _observation(
        self,
        frame: Frame,
        algorithm: str,
        payload: bytes,
        *,
        request: int = 0,
        shared_s: float = 0.0,
        encode_ms: float = 0.0,
        work_ms: float = 0.0,
    ) -> Observation:
        return Observation(
            robot=self.robot,
            instance=self._teller.instance,
            request=request,
            algorithm=algorithm,
            capture_ns=frame.capture_ns,
            frame=frame.number,
            pose=frame.scan.pose.as_tuple(),
            payload=payload,
            encode_ms=encode_ms,
            work_ms=work_ms,
            shared_s=shared_s,
        )

    @contextmanager
    def _answers(self) -> Iterator[None]:
        with self._lock:
            self._answering += 1
        try:
            yield
        finally:
            with self._lock:
                self._answering -= 1

    def _note_size(self, algorithm: str, payload: bytes) -> None:
        self._sizes.note(algorithm, payload, time.monotonic())
        for name, size in self._sizes.known().items():
            self._metrics.payload_bytes.labels(self.robot, name).set(size)

    def _frame_for(self, request: ObservationRequest) -> Frame:
        wanted_ns = request.capture_ns
        frame = self._ring.nearest(wanted_ns) if wanted_ns else self._ring.newest()
        if frame is None:
            self._count(request, "no_frame")
            raise PerceptionError(f"robot {self.robot} has no frame yet")
        gap_s = (frame.capture_ns - wanted_ns) / 1e9
        if wanted_ns and abs(gap_s) > MAX_GAP_S:
            self._count(request, "too_old")
            raise PerceptionError(
                f"no frame near {wanted_ns} ns: the nearest, {frame.number}, was captured "
                f"{abs(gap_s):.3f} s {'later' if gap_s > 0 else 'earlier'}; allowed: {MAX_GAP_S} s"
            )
        return frame

    def _count(self, request: ObservationRequest, outcome: str) -> None:
        self._metrics.requests.labels(self.robot, request.algorithm, outcome).inc()
