"""Asking robots for frames in parallel, each frame with a deadline.

Answers come in on Zenoh's threads and are taken up by the asking thread through one queue, so that
late answers of earlier frames are counted too; so is what robots publish once for several egos
(`SharedFrames`), which needs no request a frame. Frames overlap: the next one may be asked for
while answers to this one are on their way. A robot that is not in time is not asked again until it
has answered: a slow one costs its own frames, never the link or the next frame.
"""

from __future__ import annotations

import itertools
import math
import queue
import time
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass

from ego_agent.execute.answers import (
    AnswerCheck,
    Outcome,
    brings,
    contribute,
    contribution,
    why_missing,
)
from ego_agent.execute.frame_round import LATE_S, FrameRound, Missing, Question
from ego_agent.execute.lessons import Lessons
from ego_agent.execute.shared import SharedFrames
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.tally import TallyKeeper
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from swarm import keyspace
from swarm.errors import CoAdaptError, MessageError, RefusedError
from swarm.messages import MAX_MESSAGE_BYTES, Observation, ObservationRequest
from swarm.process import Clock
from swarm.session import Answer, Session

MAX_TRANSFER_S = 1.0
"""No payload may take the link longer than this: what is older shows another moment."""
MIN_PAYLOAD_BYTES = 2048
"""Boxes must always fit."""
SILENT_S = 1.0
"""When neither a beacon nor an answer has come for so long, the link carries nothing."""
SMALL_OFFSET_NS = 50_000_000
"""A smaller clock offset is taken for delay: frames are 100 ms apart."""
REQUESTS_UNDER_WAY = 2
"""Of one robot that keeps up. Answers that take longer than a frame would cost every second frame
with one; more would queue at the robot and on the link."""


@dataclass(frozen=True, slots=True)
class _Query:
    """One request under way."""

    robot: str
    request: ObservationRequest
    round: FrameRound
    session: Session
    tries: int


@dataclass(frozen=True, slots=True)
class _Arrival:
    """How a request ended, and when."""

    ask: _Query
    outcome: Outcome
    at: float


@dataclass(frozen=True, slots=True)
class _Published:
    """What a robot published for several egos, and when it came."""

    seen: Observation
    at: float


@dataclass(frozen=True, slots=True, eq=False)
class _Awaited:
    """A frame that a robot is relied upon to publish."""

    robot: str
    round: FrameRound
    capture_ns: int
    """On the robot's clock."""


class Asker:
    """Sends the requests of frames and gathers the answers. Used by the asking thread only, but for
    `nudge`."""

    def __init__(
        self,
        ego: str,
        monitor: Monitor,
        link: LinkEstimate,
        knowledge: Knowledge,
        tally: TallyKeeper,
        clock: Clock,
        frame_period_s: float,
        *,
        max_error_m: float,
        keep_ground: bool,
        share: bool = True,
    ) -> None:
        """`share`: whether the ego takes what robots publish for several."""
        self._ego = ego
        self._monitor = monitor
        self._link = link
        self.knowledge = knowledge
        self._tally = tally
        self._clock = clock
        self._lessons = Lessons(knowledge.experience, link, 1.0 / frame_period_s)
        self._check = AnswerCheck(monitor, frame_period_s)
        self._max_error_m = max_error_m
        self._keep_ground = keep_ground
        self._numbers = itertools.count(1)
        self._inbox: queue.SimpleQueue[_Arrival | _Published | None] = queue.SimpleQueue()
        self._share = share
        self._shared = SharedFrames(self._on_published, frame_period_s)
        self._awaited: list[_Awaited] = []
        self._owing: dict[str, list[_Query]] = {}
        self._prompt: set[str] = set()
        """Robots whose newest answer came in time."""
        self._rounds: list[FrameRound] = []
        """Those that still wait for answers."""
        self._answered_at = time.monotonic()

    def ask(
        self,
        session: Session | None,
        questions: Mapping[str, Question],
        capture_ns: int,
        deadline_s: float,
        *,
        probe: bool = False,
    ) -> FrameRound:
        """Asks robots for the frame captured at `capture_ns` on the ego's clock, each for what its
        question says; what comes within `deadline_s` seconds counts as in time. `probe`: only for
        the sake of its time, beside a frame.

        `attend` takes up the answers; a round in which nobody could be asked is closed at once.
        """
        now = time.monotonic()
        done = FrameRound(questions, now, deadline_s, probe=probe)
        asked: list[str] = []
        relied: list[str] = []
        for robot, question in questions.items():
            algorithm = question.algorithm
            if session is None:
                done.missing[robot] = Missing("offline", "no router")
            elif not self._monitor.is_alive(robot):
                done.missing[robot] = Missing("left", "its liveliness token is gone")
            elif any(owed.round.probe for owed in self._owing.get(robot, ())):
                done.missing[robot] = Missing("probe", "asked for another algorithm instead")
            elif self._would_share(done, robot) and self._shared.relies(robot, algorithm, now):
                relied.append(robot)
            elif self._is_busy(robot, now):
                done.missing[robot] = Missing("busy", "still owes the answer for an earlier frame")
            else:
                asked.append(robot)
        if session is None or not (asked or relied):
            done.close(now)
            return done
        capacity_bps, _ = self._link.capacity(now)
        done.capacity_bps = capacity_bps
        limits = self._link.robot_limits(now)
        done.waiting.update(asked, relied)
        for robot in (*asked, *relied):
            question = questions[robot]
            algorithm, tell = question.algorithm, question.tell
            sharing = self._would_share(done, robot)
            wanted_ns = capture_ns + self._clock_offset_ns(robot)
            done.asked_at[robot] = time.monotonic()
            if robot in relied:
                self._awaited.append(_Awaited(robot, done, wanted_ns))
                if not self._shared.is_due(robot, algorithm, now) or self._is_busy(robot, now):
                    continue
            own_bps = min(capacity_bps / len(done.waiting), limits.get(robot, capacity_bps))
            share = min(int(own_bps / 8.0 * MAX_TRANSFER_S), MAX_MESSAGE_BYTES - 4096)
            request = ObservationRequest(
                ego=self._ego,
                request=next(self._numbers),
                algorithm=algorithm,
                capture_ns=wanted_ns,
                max_error_m=self._max_error_m,
                keep_ground=self._keep_ground,
                max_bytes=max(MIN_PAYLOAD_BYTES, share),
                reference=None if tell.reference is None else tell.reference.as_tuple(),
                demand=tell.demand,
                without_outline=tell.without_outline,
                objects_only=tell.objects_only,
                shares=sharing and self._shared.wants(robot, algorithm, now),
                listens=robot in relied,
                rate_hz=question.rate_hz if sharing else 0.0,
                deadline_s=deadline_s,
            )
            self._send(_Query(robot, request, done, session, tries=1))
        self._shared.tidy(now)
        self._rounds.append(done)
        for awaited in [one for one in self._awaited if one.round is done]:
            self._look_for(awaited)
        return done

    def _would_share(self, done: FrameRound, robot: str) -> bool:
        return self._share and not done.probe and done.questions[robot].shares

    def attend(self, seconds: float) -> None:
        """Takes up answers for at most that long, and closes the rounds whose time is over; returns
        early when something has come or a round was closed."""
        now = time.monotonic()
        first_due = min((done.due_at for done in self._rounds), default=math.inf)
        try:
            arrival = self._inbox.get(timeout=max(0.0, min(seconds, first_due - now)))
            while True:
                if isinstance(arrival, _Published):
                    self._take_published(arrival)
                elif arrival is not None and not self._asked_again(arrival):
                    self._take(arrival)
                arrival = self._inbox.get_nowait()
        except queue.Empty:
            pass
        self._close_rounds(time.monotonic())

    @property
    def waits(self) -> bool:
        """Whether a round still waits for answers."""
        return bool(self._rounds)

    def nudge(self) -> None:
        """Lets `attend` return. From any thread."""
        self._inbox.put(None)

    def _close_rounds(self, now: float) -> None:
        for done in [r for r in self._rounds if not r.waiting or now >= r.due_at]:
            self._rounds.remove(done)
            self._settle_awaited(done, now)
            silent_s = min(now - self._answered_at, self._monitor.silent_s())
            if done.waiting and not done.probe and silent_s >= SILENT_S:
                self._link.silence(now)
            for robot in done.waiting - done.focused(done.waiting):
                self._lessons.silence(done, robot)
            done.close(now)

    def _is_busy(self, robot: str, now: float) -> bool:
        """Whether one more request would only queue: the robot is late already, or has as many
        under way as one that keeps up may have."""
        owed = [ask.round for ask in self._owing.get(robot, ()) if now < ask.round.given_up_at]
        most = REQUESTS_UNDER_WAY if robot in self._prompt else 1
        return len(owed) >= most or any(now >= done.due_at for done in owed)

    def _send(self, ask: _Query) -> None:
        self._owing.setdefault(ask.robot, []).append(ask)

        def finished(future: Future[Answer[Observation]]) -> None:
            # On a Zenoh thread: note the time and hand over.
            error = future.exception()
            outcome = error if isinstance(error, CoAdaptError) else None
            if error is not None and outcome is None:
                outcome = MessageError(f"internal error: {error!r}")
            at = time.monotonic()
            self._inbox.put(_Arrival(ask, outcome if outcome is not None else future.result(), at))

        ask.session.ask(
            keyspace.observation(ask.session.swarm, ask.robot),
            ask.request,
            Observation,
            timeout_s=ask.round.deadline_s + LATE_S,
        ).add_done_callback(finished)

    def _asked_again(self, arrival: _Arrival) -> bool:
        """Asks once more when nobody answered although the robot is there: after a reconnect its
        liveliness token may arrive before its queryable."""
        ask = arrival.ask
        unanswered = isinstance(arrival.outcome, CoAdaptError) and not isinstance(
            arrival.outcome, RefusedError | MessageError
        )
        if not unanswered or ask.tries > 1 or arrival.at >= ask.round.due_at:
            return False
        if not self._monitor.is_alive(ask.robot):
            return False
        self._settle(ask)
        self._send(_Query(ask.robot, ask.request, ask.round, ask.session, tries=2))
        return True

    def _settle(self, ask: _Query) -> None:
        """The robot does not owe this answer any more."""
        owed = [other for other in self._owing.pop(ask.robot, ()) if other is not ask]
        if owed:
            self._owing[ask.robot] = owed

    def _take(self, arrival: _Arrival) -> None:
        """Counts an answer, and gives what it brings to its frame, if that still waits for it."""
        ask, done = arrival.ask, arrival.ask.round
        algorithm = ask.request.algorithm
        wrong: Missing | None = None
        if isinstance(arrival.outcome, Answer):
            self._answered_at = arrival.at
            wrong = self._check.answer(ask.robot, ask.request, arrival.outcome.message)
        focused = done.questions[ask.robot].focused
        if focused:
            # What it takes tells nothing of whole ones.
            self._lessons.link(ask.robot, arrival.outcome, arrival.at, wrong)
        elif not ask.request.listens:
            self._lessons.answer(ask.robot, done, arrival.outcome, arrival.at, wrong)
        self._settle(ask)
        if ask.request.shares and isinstance(arrival.outcome, Answer):
            told = arrival.outcome.message.shared_s
            self._shared.promised(ask.session, ask.robot, algorithm, told, arrival.at)
        if ask.request.listens and not brings(arrival.outcome):
            return  # Only a renewal: the frame itself is published.
        late = ask.robot not in done.waiting
        done.waiting.discard(ask.robot)
        self._awaited = [
            one for one in self._awaited if (one.robot, one.round) != (ask.robot, done)
        ]
        if isinstance(arrival.outcome, CoAdaptError):
            if not done.probe:
                self._prompt.discard(ask.robot)
            if not late:
                done.missing[ask.robot] = why_missing(arrival.outcome)
            return
        if not done.probe:
            (self._prompt.discard if late else self._prompt.add)(ask.robot)
        done.arrived_at[ask.robot] = arrival.at
        answer = arrival.outcome
        seen = answer.message
        self._tally.received(ask.robot, algorithm, len(seen.payload), late=late)
        self._monitor.note_round_trip(ask.robot, answer.round_trip_s)
        if wrong is None:
            self._monitor.note_answer(seen)
            # To say which places takes bytes like what is answered.
            size = len(seen.payload) + (len(ask.request.demand) if focused else 0)
            at_ns = self._clock.now_ns()
            self.knowledge.record_payload(
                ask.robot,
                algorithm,
                size,
                at_ns,
                focused=focused,
                objects_only=ask.request.objects_only,
            )
        if late and wrong is None and ask.robot in done.missing and not done.probe:
            # Its frame is fused, but memory can still take it up.
            done.take_late(contribution(done, ask.request.capture_ns, seen))
        if late or done.probe:
            return
        if wrong is not None:
            done.missing[ask.robot] = wrong
            return
        contribute(done, ask.request.capture_ns, seen)

    def _on_published(self, seen: Observation) -> None:
        # On a Zenoh thread: note the time and hand over.
        self._inbox.put(_Published(seen, time.monotonic()))

    def _take_published(self, published: _Published) -> None:
        """Counts what a robot published, and gives it to the frames that wait for it."""
        seen = published.seen
        if not self._shared.take(seen, published.at):
            return
        self._answered_at = published.at
        self._tally.received(seen.robot, seen.algorithm, len(seen.payload), late=False)
        for awaited in [one for one in self._awaited if one.robot == seen.robot]:
            self._look_for(awaited)

    def _look_for(self, awaited: _Awaited, *, at_most_ns: int | None = None) -> None:
        """Takes a frame up that was relied upon, if it has come."""
        robot, done = awaited.robot, awaited.round
        algorithm = done.algorithm_of(robot)
        found = self._shared.find(robot, algorithm, awaited.capture_ns, at_most_ns=at_most_ns)
        if found is None or robot not in done.waiting:
            return
        seen, came_at = found
        self._awaited.remove(awaited)
        done.waiting.discard(robot)
        at = max(came_at, done.asked_at[robot])
        answer = Answer(seen, len(seen.payload), at - done.asked_at[robot])
        wrong = self._check.frame(robot, awaited.capture_ns, seen)
        self._lessons.answer(robot, done, answer, at, wrong)
        done.arrived_at[robot] = at
        if wrong is not None:
            done.missing[robot] = wrong
            return
        self._monitor.note_answer(seen)
        size, at_ns = len(seen.payload), self._clock.now_ns()
        self.knowledge.record_payload(robot, algorithm, size, at_ns)
        contribute(done, awaited.capture_ns, seen)

    def _settle_awaited(self, done: FrameRound, now: float) -> None:
        """The time of a frame is over: where nothing was published of it, the frame beside it will
        do."""
        for awaited in [one for one in self._awaited if one.round is done]:
            self._look_for(awaited, at_most_ns=self._check.max_skew_ns)
            if awaited in self._awaited:
                self._awaited.remove(awaited)
                self._shared.missed(awaited.robot, done.algorithm_of(awaited.robot), now)

    def _clock_offset_ns(self, robot: str) -> int:
        offset_ns = self._monitor.clock_offset_ns(robot)
        return offset_ns if abs(offset_ns) >= SMALL_OFFSET_NS else 0
