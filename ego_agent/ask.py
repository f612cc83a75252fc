"""Asking robots for one frame in parallel, with a deadline.

Answers come in on Zenoh's threads and are taken up by the fusion thread through one queue, so that
late answers of earlier frames are counted too. A robot that still owes an answer is not asked
again: a slow one costs its own frames, never the link or the next frame.
"""

from __future__ import annotations

import itertools
import queue
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field

from ego_agent.knowledge import Knowledge
from ego_agent.link import LinkEstimate
from ego_agent.monitor import Monitor
from ego_agent.rounds import Transfer, measure
from ego_agent.tally import TallyKeeper
from perception.fusion.base import Ask, Contribution
from swarm import keyspace
from swarm.errors import CoAdaptError, MessageError, RefusedError
from swarm.messages import MAX_MESSAGE_BYTES, Algorithm, Observation, ObservationRequest
from swarm.process import Clock
from swarm.session import Answer, Session

MAX_TRANSFER_S = 1.0
"""No payload may take the link longer than this: what is older shows another moment."""
MIN_PAYLOAD_BYTES = 2048
"""Boxes must always fit."""
MAX_TRANSFERS = 512
"""Answers that are remembered to see what else was on the link while one was on its way."""
LATE_S = 1.25
"""How long after the deadline an answer may still come; its bytes are counted then."""
SMALL_OFFSET_NS = 50_000_000
"""A smaller clock offset is taken for delay: frames are 100 ms apart."""
MAX_SKEW_FRAMES = 1.5
"""An answer farther off than this many frame periods shows another moment: a robot that reads its
scan a little later than the ego gives the frame before."""


@dataclass(frozen=True, slots=True)
class _Ask:
    """One request under way."""

    robot: str
    request: ObservationRequest
    round: FrameRound
    tries: int


@dataclass(frozen=True, slots=True)
class _Arrival:
    """How a request ended, and when."""

    ask: _Ask
    outcome: Answer[Observation] | CoAdaptError
    at: float


@dataclass(slots=True, eq=False)
class FrameRound:
    """The requests of one fused frame."""

    algorithm: Algorithm
    begun_at: float
    deadline_s: float
    contributions: list[Contribution] = field(default_factory=list)
    bytes: dict[str, int] = field(default_factory=dict)
    """Payload bytes of the contributions that arrived in time, by robot."""
    missing: dict[str, str] = field(default_factory=dict)
    """Robots without a contribution: `kind: detail`."""
    waiting: set[str] = field(default_factory=set)
    open: set[str] = field(default_factory=set)
    """Robots whose request has not ended, be it late."""
    encode_ms: dict[str, float] = field(default_factory=dict)
    """How long each contribution's robot took to encode it."""

    @property
    def given_up_at(self) -> float:
        """When no answer can come any more: a second try may end as late as this."""
        return self.begun_at + 2.0 * (self.deadline_s + LATE_S)


class Asker:
    """Sends the requests of a frame and gathers the answers. Used by the fusion thread only."""

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
    ) -> None:
        self._ego = ego
        self._monitor = monitor
        self._link = link
        self._knowledge = knowledge
        self._tally = tally
        self._clock = clock
        self._max_skew_ns = round(MAX_SKEW_FRAMES * frame_period_s * 1e9)
        self._max_error_m = max_error_m
        self._keep_ground = keep_ground
        self._numbers = itertools.count(1)
        self._inbox: queue.SimpleQueue[_Arrival] = queue.SimpleQueue()
        self._owing: dict[str, _Ask] = {}
        self._transfers: deque[Transfer] = deque(maxlen=MAX_TRANSFERS)

    def ask(
        self,
        session: Session | None,
        robots: tuple[str, ...],
        algorithm: Algorithm,
        capture_ns: int,
        deadline_s: float,
        tell: Ask | None = None,
    ) -> FrameRound:
        """Asks the robots for the frame captured at `capture_ns` on the ego's clock; what comes
        within `deadline_s` seconds counts as in time. `tell`: what they need to know to encode."""
        tell = tell or Ask()
        now = time.monotonic()
        done = FrameRound(algorithm, now, deadline_s)
        asked: list[str] = []
        for robot in robots:
            owed = self._owing.get(robot)
            if session is None:
                done.missing[robot] = "offline: no router"
            elif not self._monitor.is_alive(robot):
                done.missing[robot] = "left: its liveliness token is gone"
            elif owed is not None and now < owed.round.given_up_at:
                done.missing[robot] = "busy: still owes the answer for an earlier frame"
            else:
                asked.append(robot)
        if session is None or not asked:
            return done
        capacity_bps, _ = self._link.capacity(now)
        limits = self._link.robot_limits(now)
        done.waiting.update(asked)
        done.open.update(asked)
        for robot in asked:
            own_bps = min(capacity_bps / len(asked), limits.get(robot, capacity_bps))
            share = min(int(own_bps / 8.0 * MAX_TRANSFER_S), MAX_MESSAGE_BYTES - 4096)
            request = ObservationRequest(
                ego=self._ego,
                request=next(self._numbers),
                algorithm=algorithm,
                capture_ns=capture_ns + self._clock_offset_ns(robot),
                max_error_m=self._max_error_m,
                keep_ground=self._keep_ground,
                max_bytes=max(MIN_PAYLOAD_BYTES, share),
                reference=None if tell.reference is None else tell.reference.as_tuple(),
                demand=tell.demand,
            )
            self._send(session, _Ask(robot, request, done, tries=1))
        return done

    def collect(
        self,
        session: Session | None,
        done: FrameRound,
        take_up: Callable[[Contribution], None],
    ) -> None:
        """Waits until every robot of the frame has answered or the deadline has passed; gives each
        contribution to `take_up` when it arrives."""
        until = done.begun_at + done.deadline_s
        while done.waiting and (left := until - time.monotonic()) > 0:
            try:
                arrival = self._inbox.get(timeout=left)
            except queue.Empty:
                break
            if self._asked_again(session, arrival):
                continue
            contribution = self._take(arrival)
            if contribution is not None:
                take_up(contribution)
        now = time.monotonic()
        if done.waiting and not any(t.end_s >= done.begun_at for t in self._transfers):
            self._link.silence(now)
        for robot in sorted(done.waiting):
            done.missing[robot] = f"deadline: no answer within {done.deadline_s:g} s"
        done.waiting.clear()

    def wait(self, seconds: float) -> None:
        """Takes up late answers for a while; returns early when one has come."""
        try:
            self._take(self._inbox.get(timeout=max(0.0, seconds)))
        except queue.Empty:
            return

    def _send(self, session: Session, ask: _Ask) -> None:
        self._owing[ask.robot] = ask

        def finished(future: Future[Answer[Observation]]) -> None:
            # On a Zenoh thread: note the time and hand over.
            error = future.exception()
            outcome = error if isinstance(error, CoAdaptError) else None
            if error is not None and outcome is None:
                outcome = MessageError(f"internal error: {error!r}")
            at = time.monotonic()
            self._inbox.put(_Arrival(ask, outcome if outcome is not None else future.result(), at))

        session.ask(
            keyspace.observation(session.swarm, ask.robot),
            ask.request,
            Observation,
            timeout_s=ask.round.deadline_s + LATE_S,
        ).add_done_callback(finished)

    def _asked_again(self, session: Session | None, arrival: _Arrival) -> bool:
        """Asks once more when nobody answered although the robot is there: after a reconnect its
        liveliness token may arrive before its queryable."""
        ask = arrival.ask
        unanswered = isinstance(arrival.outcome, CoAdaptError) and not isinstance(
            arrival.outcome, RefusedError | MessageError
        )
        if (
            not unanswered
            or ask.tries > 1
            or session is None
            or arrival.at >= ask.round.begun_at + ask.round.deadline_s
        ):
            return False
        if not self._monitor.is_alive(ask.robot):
            return False
        self._send(session, _Ask(ask.robot, ask.request, ask.round, tries=2))
        return True

    def _take(self, arrival: _Arrival) -> Contribution | None:
        """Counts an answer; returns what it brings to its frame, if that still waits for it."""
        ask, done = arrival.ask, arrival.ask.round
        self._learn(arrival)
        if self._owing.get(ask.robot) is ask:
            del self._owing[ask.robot]
        late = ask.robot not in done.waiting
        done.waiting.discard(ask.robot)
        if isinstance(arrival.outcome, CoAdaptError):
            if not late:
                done.missing[ask.robot] = _why(arrival.outcome)
            return None
        answer = arrival.outcome
        seen = answer.message
        self._tally.received(ask.robot, done.algorithm, len(seen.payload), late=late)
        self._monitor.note_round_trip(ask.robot, answer.round_trip_s)
        wrong = self._mismatch(ask, seen)
        if wrong is None:
            size, at_ns = len(seen.payload), self._clock.now_ns()
            self._knowledge.record_payload(ask.robot, done.algorithm, size, at_ns)
        if late:
            return None
        if wrong is not None:
            done.missing[ask.robot] = wrong
            return None
        done.bytes[ask.robot] = len(seen.payload)
        done.encode_ms[ask.robot] = seen.encode_ms
        age_s = (ask.request.capture_ns - seen.capture_ns) * 1e-9
        pose = seen.sensor_pose().matrix()
        contribution = Contribution(ask.robot, seen.payload, pose, age_s)
        done.contributions.append(contribution)
        return contribution

    def _learn(self, arrival: _Arrival) -> None:
        """Notes when an answer was on its way; the last one of its frame, be it late, completes
        what the frame shows of the links."""
        ask, done = arrival.ask, arrival.ask.round
        if isinstance(arrival.outcome, Answer):
            encoded_at = done.begun_at + arrival.outcome.message.encode_ms * 1e-3
            size, start = arrival.outcome.wire_bytes, min(encoded_at, arrival.at)
            self._transfers.append(Transfer(ask.robot, size, start, arrival.at))
        done.open.discard(ask.robot)
        shown = None if done.open else measure(self._transfers, done.begun_at)
        if shown is not None:
            self._link.add_round(shown, arrival.at)

    def _mismatch(self, ask: _Ask, seen: Observation) -> str | None:
        """Why an answer is not what was asked for."""
        asked = ask.request
        if (seen.robot, seen.request, seen.algorithm) != (
            ask.robot,
            asked.request,
            asked.algorithm,
        ):
            return (
                f"invalid: answer {seen.request} of {seen.robot} ({seen.algorithm}) to request "
                f"{asked.request} to {ask.robot} ({asked.algorithm})"
            )
        skew_ns = seen.capture_ns - asked.capture_ns
        if abs(skew_ns) > self._max_skew_ns:
            return f"skew: its frame is {skew_ns * 1e-9:+.3f} s off"
        return None

    def _clock_offset_ns(self, robot: str) -> int:
        offset_ns = self._monitor.clock_offset_ns(robot)
        return offset_ns if abs(offset_ns) >= SMALL_OFFSET_NS else 0


MISSING_KINDS = (
    "offline", "left", "busy", "deadline", "refused", "invalid", "unanswered", "skew", "rejected",
)  # fmt: skip
"""Why a chosen robot is not in a fused frame: the part of a reason before its colon."""


def kind_of(reason: str) -> str:
    """The kind of a reason in `FrameRound.missing`: one of MISSING_KINDS."""
    return reason.split(":", 1)[0]


def _why(error: CoAdaptError) -> str:
    if isinstance(error, RefusedError):
        return f"refused: {error}"
    if isinstance(error, MessageError):
        return f"invalid: {error}"
    return f"unanswered: {error}"
