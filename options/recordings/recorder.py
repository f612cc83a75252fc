"""Turns what a swarm says into a recording, message by message."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from deploy.spec import SwarmSpec
from options.recordings import format as layout
from options.recordings import shapes
from options.recordings.fused import fused_of
from options.recordings.listen import Presence, Received
from options.recordings.outlet import Outlet
from options.recordings.scans import Scans
from options.ros.fused import PREFIX, Said, Teller
from swarm.arrays import unpack_finite
from swarm.errors import MessageError, WorldError
from swarm.messages import Beacon, Decision, Detections, NetState, SceneDescription

SECOND_NS = 1_000_000_000
MAX_DONE = 256
"""Frames of which a second word is recognised."""


class Recorder:
    """Writes one recording. Counts what it wrote."""

    def __init__(
        self,
        spec: SwarmSpec,
        outlet: Outlet,
        scans: Scans | None,
        points: layout.Points,
        now_ns: int,
        ros: Teller | None = None,
    ) -> None:
        """Writes the header. `scans` is None where no scans are recorded; `ros` where fused objects
        are not written as ROS 2 messages, too."""
        self._spec = spec
        self._outlet = outlet
        self._scans = scans
        self._points = points
        self._ros = ros
        self.fused = 0
        """Fused frames of the ego."""
        self.frames = 0
        """Of these, frames that were written with scans."""
        self.left_out = 0
        """Frames without their scans, because there was no time for them or they failed."""
        self.fault = ""
        """Why the last scan could not be had."""
        self._capacity_bps: float | None = None
        self._recent: deque[tuple[int, int]] = deque()
        self._done: deque[int] = deque(maxlen=MAX_DONE)
        self._alive: dict[str, bool] = {}
        self._missing: dict[str, str] = {}
        self._remembered: frozenset[int] = frozenset()
        """Ids of what was last drawn as remembered."""
        self._write: dict[type, Callable[..., None]] = {
            Beacon: self._beacon,
            SceneDescription: self._scene,
            Decision: self._decision,
            NetState: self._links,
            Presence: self._presence,
        }
        world = None if scans is None else scans.world
        outlet.put_json(
            layout.HEADER,
            layout.Header(
                swarm=spec.swarm,
                ego=spec.ego,
                robots=spec.robots if scans is None else scans.robots,
                world=spec.world,
                epoch_ns=spec.epoch_ns,
                points=points,
                rate_hz=world.rate_hz if world else None,
                range_m=world.range_m if world else None,
                detector=world.detector if world else None,
                comm_range_m=spec.comm_range_m,
                started_ns=now_ns,
            ),
            now_ns,
        )
        outlet.flush()

    def flush(self) -> None:
        """See `Outlet.flush`."""
        self._outlet.flush()

    def take(self, heard: Received, hurry: bool = False) -> None:
        """Writes one message; in a hurry a fused frame without its scans."""
        try:
            if isinstance(heard.message, Detections):
                self._detections(heard.message, hurry)
            else:
                self._write[type(heard.message)](heard.message, heard.came_ns)
        except MessageError as error:
            self._log(f"a message cannot be recorded: {error}", "warning", "record", heard.came_ns)

    def _beacon(self, beacon: Beacon, came_ns: int) -> None:
        pose = beacon.sensor_pose()
        self._outlet.put_json(layout.beacon_topic(beacon.robot), beacon, came_ns)
        self._outlet.put(
            layout.pose_topic(beacon.robot), shapes.pose_in_world(pose, came_ns), came_ns
        )
        if self._scans is None:
            self._outlet.put(
                layout.TRANSFORMS, shapes.transforms({beacon.robot: pose}, came_ns), came_ns
            )

    def _scene(self, scene: SceneDescription, came_ns: int) -> None:
        table = unpack_finite(scene.objects, "objects", 9)
        robots = self._spec.robots
        place = robots.index(scene.robot) if scene.robot in robots else len(robots)
        color = shapes.OBJECT_COLORS[place % len(shapes.OBJECT_COLORS)]
        self._outlet.put(
            layout.objects_topic(scene.robot), shapes.objects(table, came_ns, color), came_ns
        )
        if self._ros is not None:
            self._say(self._ros.on_scene(scene, came_ns))

    def _decision(self, decision: Decision, came_ns: int) -> None:
        self._capacity_bps = decision.capacity_bps
        self._outlet.put_json(layout.DECISION, decision, came_ns)
        who = ", ".join(decision.participants)
        level = "info" if decision.valid and decision.source != "fallback" else "warning"
        text = f"cycle {decision.cycle}: {decision.algorithm} from {who}: {decision.reason}"
        self._log(text, level, f"ego {decision.ego}", came_ns)
        for repair in decision.repairs:
            self._log(f"repaired: {repair}", "warning", f"ego {decision.ego}", came_ns)

    def _links(self, state: NetState, came_ns: int) -> None:
        self._outlet.put_json(layout.LINKS, state, came_ns)

    def _presence(self, presence: Presence, came_ns: int) -> None:
        if self._alive.get(presence.robot) == presence.alive:
            return
        self._alive[presence.robot] = presence.alive
        word, level = ("joined", "info") if presence.alive else ("left", "warning")
        self._log(f"{presence.robot} {word}", level, "swarm", came_ns)

    def _detections(self, message: Detections, hurry: bool) -> None:
        # A session that replaces a broken one may bring a message twice; a smaller number does not
        # say so, for the ego's clock may have been set back.
        if message.frame in self._done:
            return
        fused = fused_of(message)
        self._done.append(message.frame)
        self.fused += 1
        time_ns = message.capture_ns
        if self._scans is not None and self._scans.wants(message.frame):
            self._frame(self._scans, message, hurry)
        self._outlet.put_json(layout.FUSED, fused, time_ns)
        shown = (*fused.boxes, *(fused.known or ()))
        drawn = shapes.boxes(shown, time_ns, shapes.FUSED_COLOR, shapes.SEEN_OPACITY)
        self._outlet.put(layout.FUSED_BOXES, drawn, time_ns)
        if fused.tracks is not None:
            remembered = frozenset(one.id for one in fused.tracks)
            gone = self._remembered - remembered
            self._outlet.put(layout.TRACKS, shapes.tracks(fused.tracks, gone, time_ns), time_ns)
            self._remembered = remembered
        if self._ros is not None:
            self._say(self._ros.on_detections(message))
        self._budget(message)
        # The words may hold other figures in every frame; egos of older programs tell no kinds.
        kinds = {**message.missing, **message.missing_kinds}
        for robot, why in message.missing.items():
            if self._missing.get(robot) != kinds[robot]:
                self._log(f"{robot} is missing: {why}", "warning", f"ego {message.ego}", time_ns)
        self._missing = kinds

    def _frame(self, scans: Scans, message: Detections, hurry: bool) -> None:
        if hurry:
            self.left_out += 1
            return
        try:
            scans.write(message, self._outlet)
            self.frames += 1
        except WorldError as error:
            self.left_out += 1
            if str(error) != self.fault:
                self.fault = str(error)
                self._log(self.fault, "error", "record", message.capture_ns)

    def _budget(self, message: Detections) -> None:
        now_ns, size = message.capture_ns, sum(message.bytes.values())
        if self._recent and self._recent[-1][0] > now_ns:
            self._recent.clear()
        self._recent.append((now_ns, size))
        while self._recent[0][0] <= now_ns - SECOND_NS:
            self._recent.popleft()
        budget = layout.Budget(
            frame=message.frame,
            bytes=size,
            used_bps=8.0 * sum(size for _, size in self._recent),
            capacity_bps=self._capacity_bps,
        )
        self._outlet.put_json(layout.BUDGET, budget, now_ns)

    def _say(self, messages: tuple[Said, ...]) -> None:
        for one in messages:
            self._outlet.put_ros(PREFIX + one.topic.name, one.topic.kind, one.payload, one.stamp_ns)

    def _log(self, text: str, level: str, name: str, time_ns: int) -> None:
        self._outlet.put(layout.LOG, shapes.log(text, level, name, time_ns), time_ns)
