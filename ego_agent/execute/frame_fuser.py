"""Fuses what arrives of one frame, and remembers what it shows."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ego_agent.execute.frame_round import FrameRound, Missing
from ego_agent.execute.pipeline import AskedFrame
from ego_agent.execute.sense import OwnFrame
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.own_costs import LIGHTER
from ego_agent.monitor.known import KnownRobots
from perception.fusion.aligner import Held
from perception.fusion.base import Contribution, Fusion
from perception.fusion.known import KnownRobot, seen_at
from perception.fusion.mixed import Mixed, scored_by
from perception.fusion.publishing import operating_point, publish
from perception.memory.memory import Frame, Remembered, View
from perception.memory.poses import PoseMemory
from perception.memory.remembering import remember, suspected
from perception.memory.reprocessing import ReprocessingMemory
from perception.types import Boxes
from swarm.errors import PerceptionError
from swarm.geometry import Matrix
from swarm.log import Logger

RECENT = 6
"""Frames that late contributions may still belong to."""
OF_LATE_NS = 5 * 10**9
"""By what a pose was off so long ago says nothing of a contribution that comes late."""


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One fused frame."""

    own: OwnFrame
    round: FrameRound
    boxes: Boxes
    """Detections in the world frame."""
    known: tuple[KnownRobot, ...]
    """Robots of which fresh beacons tell, in the world frame."""
    participants: tuple[str, ...]
    corrections: Mapping[str, Matrix]
    """By what participants' poses were put right, 4 x 4 in the world frame."""
    missing: Mapping[str, Missing]
    latency_ms: float
    """From the first query to the fused boxes."""
    wait_ms: float
    """How long the answers that were there waited for the frame before to be fused."""
    add_ms: float
    """Taking up what arrived, while others still encode."""
    fuse_ms: float
    """From all that was taken up to the fused boxes."""
    tracks: Remembered | None = None
    """What is there by all that was found until now; None without a memory."""
    operating_point: float | None = None
    """The score from which on boxes are among the detections; None where nobody has calibrated."""

    def missing_kinds(self) -> dict[str, str]:
        """The kind of why each missing robot is not in it."""
        return {robot: why.kind for robot, why in self.missing.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Suspected:
    """All that may be there, told or not, but for known robots."""

    time_s: float
    """Capture of the frame by which it is known, on the ego's clock."""
    tracks: Remembered


@dataclass(slots=True)
class _Fused:
    """One of the last frames, and what was fused in it."""

    frame: AskedFrame
    used: list[Contribution]
    corrections: dict[str, Matrix]
    """By what their poses were put right, 4 x 4 in the world frame."""


class FrameFuser:
    """Fuses frames in their order. Used by one thread."""

    def __init__(
        self,
        ego: str,
        fusions: Mapping[str, Fusion],
        knowledge: Knowledge,
        log: Logger,
        *,
        detector: str,
        known: KnownRobots,
        memory: ReprocessingMemory | None,
        poses: PoseMemory | None,
    ) -> None:
        """`knowledge` learns what fusing costs. `detector`: the world's. `known`: of whom beacons
        tell. `memory`: of objects. `poses`: by what poses are off."""
        self._ego = ego
        self._fusions = fusions
        self._knowledge = knowledge
        self._log = log
        self._detector = detector
        self._known = known
        self._memory = memory
        self._poses = poses
        self._recent: deque[_Fused] = deque(maxlen=RECENT)
        self._corrections: dict[str, tuple[int, Matrix]] = {}
        """By what each participant's pose was put right last, 4 x 4 in the world frame, and in
        which frame, by its capture."""
        self.remembered: Remembered | None = None
        """What was there at the newest frame; None without a memory. Any thread may read."""
        self.suspected: Suspected | None = None
        """The same with what is too unlikely to be told; None where the decision asks nobody about
        places. Any thread may read."""
        self.whole: frozenset[str] = frozenset()
        """Robots whose newest whole contribution that came in time was fused, not refused. Any
        thread may read."""

    def fuse(self, frame: AskedFrame, taken_at: float) -> FrameResult:
        """Takes up what arrives until the frame's round is closed, and fuses it; `taken_at`: when
        that began, `time.monotonic()` seconds."""
        own, gathering, done = frame.own, frame.gathering, frame.round
        prepare_at = time.monotonic()
        gathering.prepare()
        prepare_s = time.monotonic() - prepare_at
        rejected: dict[str, Missing] = {}
        left_out: dict[str, str] = {}
        add_s = work_s = 0.0
        for contribution in done.contributions_in_turn():
            begun_at, work_begun_s = time.monotonic(), time.thread_time()
            # One robot's payload must not end the frame, whatever is wrong with it.
            try:
                gathering.add(contribution)
            except Exception as error:
                rejected[contribution.robot] = self._fault(error, own)
            else:
                add_s += time.monotonic() - begun_at
                work_s += time.thread_time() - work_begun_s
        fuse_at = time.monotonic()
        try:
            found, corrections = gathering.finish(), gathering.corrections()
            clouds = gathering.sent_points()
            left_out = gathering.left_out()
            rejected |= {robot: Missing("unplaced", why) for robot, why in left_out.items()}
        except Exception as error:
            if not done.contributions:
                raise
            why = self._fault(error, own)
            rejected = {c.robot: why for c in done.contributions}
            found = frame.fusion.begin(own.points, own.world_from_sensor).finish()
            corrections, clouds = {}, {}
        taken = [c for c in done.contributions if c.robot not in rejected]
        used = tuple(c.robot for c in taken)
        self._recent.append(_Fused(frame, taken, corrections))
        self._corrections |= {r: (own.capture_ns, by) for r, by in corrections.items()}
        self._corrections = {
            robot: (at_ns, by)
            for robot, (at_ns, by) in self._corrections.items()
            if 0 <= own.capture_ns - at_ns <= OF_LATE_NS
        }
        judged_as = self._judged_as(frame, used)
        known = self._known_at(own, corrections)
        believed = _believed(known, frame)
        boxes = publish(found, self._detector, judged_as, len(used), believed)
        clouds[self._ego] = (own.points, own.world_from_sensor)
        tracks = self._remembered(frame, judged_as, found, frozenset(used), believed, clouds)
        self.remembered = tracks
        asks = any(one.places_hz > 0.0 for one in frame.decision.assignments)
        there = None
        if asks and tracks is not None and self._memory is not None:
            there = Suspected(own.capture_ns * 1e-9, suspected(self._memory, believed))
        # Whoever asks for the next frame meanwhile goes by what was there before.
        self.suspected = there
        places = done.focused(done.questions)
        for robot in {*used, *left_out} - places:
            self._knowledge.placing.record(robot, placed=robot not in left_out)
        self.whole = (self.whole - (rejected.keys() - places)) | ({*used} - places)
        end_at = time.monotonic()
        fixed_s = prepare_s + end_at - fuse_at
        lighter = len(places & {*used})
        contributions = len(used) - lighter + LIGHTER * lighter
        own_costs = self._knowledge.own_costs
        if isinstance(frame.fusion, Mixed):
            # What its contributions take differs by form, the rest does not.
            for form in frame.fusion.forms:
                own_costs.record(form, 0.0, fixed_s, 0.0, 0.0)
        else:
            own_costs.record(frame.algorithm, contributions, fixed_s, add_s, work_s)
        assert done.closed_at is not None
        return FrameResult(
            own=own,
            round=done,
            boxes=boxes,
            known=known,
            participants=(self._ego, *sorted(used)),
            corrections=corrections,
            missing=done.missing | rejected,
            latency_ms=(end_at - done.begun_at) * 1e3,
            wait_ms=max(0.0, taken_at - done.closed_at) * 1e3,
            add_ms=add_s * 1e3,
            fuse_ms=(end_at - fuse_at) * 1e3,
            tracks=tracks,
            operating_point=operating_point(self._detector, judged_as),
        )

    def catch_up(self) -> int:
        """Fuses the newest of the last frames anew of which more has come since it was fused, and
        has memory take that in place of what it knew of it. Returns how many contributions that
        were."""
        if self._memory is None:
            return 0
        for fused in reversed(self._recent):
            if not self._memory.holds(fused.frame.own.capture_ns * 1e-9):
                return 0
            more = fused.frame.round.late_contributions()
            if more:
                return self._amend(fused, more)
        return 0

    def _amend(self, fused: _Fused, more: list[Contribution]) -> int:
        frame, own = fused.frame, fused.frame.own
        gathering = frame.fusion.begin(own.points, own.world_from_sensor)
        held = {robot: by for robot, (_, by) in self._corrections.items()} | fused.corrections
        gathering.remembered = Held(held, own.world_from_sensor)
        taken: list[Contribution] = []
        for contribution in (*fused.used, *more):
            try:
                gathering.add(contribution)
            except Exception as error:
                self._fault(error, own)
            else:
                taken.append(contribution)
        if len(taken) <= len(fused.used):
            return 0
        try:
            found, views = gathering.finish(), gathering.sent_points()
            left_out = gathering.left_out()
            known = self._known_at(own, gathering.corrections())
        except Exception as error:
            self._fault(error, own)
            return 0
        taken = [c for c in taken if c.robot not in left_out]
        count = len(taken) - len(fused.used)
        fused.used = taken
        used = [c.robot for c in taken]
        views[self._ego] = (own.points, own.world_from_sensor)
        judged_as = self._judged_as(frame, used)
        believed = _believed(known, frame)
        self._remembered(frame, judged_as, found, frozenset(used), believed, views)
        return count

    def _known_at(self, own: OwnFrame, corrections: Mapping[str, Matrix]) -> tuple[KnownRobot, ...]:
        """Robots of which beacons tell, where a frame and those before it show them to be."""
        told = self._known.at(own.capture_ns)
        if self._poses is None:
            return seen_at(told, corrections)
        return self._poses.put_right(
            told, corrections, own.capture_ns * 1e-9, own.world_from_sensor
        )

    def _judged_as(self, frame: AskedFrame, used: Iterable[str]) -> Fusion:
        """Whose calibration the scores of a frame have to which these robots contributed."""
        if not isinstance(frame.fusion, Mixed):
            return frame.fusion
        sent = [frame.round.algorithm_of(robot) for robot in used]
        return self._fusions[scored_by(sent) if sent else next(iter(frame.fusion.forms))]

    def _remembered(
        self,
        frame: AskedFrame,
        judged_as: Fusion,
        found: Boxes,
        helpers: frozenset[str],
        known: tuple[KnownRobot, ...],
        views: Mapping[str, View],
    ) -> Remembered | None:
        """What memory makes of a frame's boxes, which `helpers` have shown beside the ego."""
        if self._memory is None:
            return None
        focused = frame.round.focused(helpers)
        objects_only = frame.round.objects_only(helpers)
        shown = Frame(
            frame.own.capture_ns * 1e-9,
            found,
            helpers,
            # Nothing beside what they send is known to be free.
            {robot: view for robot, view in views.items() if robot not in focused | objects_only},
            frame.own.world_from_sensor,
            focused=focused,
            places=frame.round.places,
            objects_only=objects_only,
        )
        try:
            return remember(self._memory, shown, self._detector, judged_as, known)
        except Exception:
            # What was seen now is published all the same.
            self._log.error("memory_failed", frame=frame.own.frame, exc_info=True)
            self._memory.clear()
            return None

    def _fault(self, error: Exception, own: OwnFrame) -> Missing:
        """Why a contribution is rejected; a fault that is not the payload's is logged."""
        if isinstance(error, PerceptionError):
            return Missing("rejected", str(error))
        self._log.error("fusion_failed", frame=own.frame, exc_info=True)
        return Missing("rejected", f"fusion failed: {type(error).__name__}")


def _believed(known: tuple[KnownRobot, ...], frame: AskedFrame) -> tuple[KnownRobot, ...]:
    """Without those whom others do not see where they say that they are: what is found there is
    told, as it may be anything."""
    return tuple(one for one in known if one.robot not in frame.decision.doubted)
