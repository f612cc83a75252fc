"""A control window as it would go: robots are asked, encode, send and come in time or not.

Every frame period the ego asks the participants (ego_agent/execute); each encodes, and its payload
goes through its own link and then, one after the other, through the ego's cell. The frame is closed
when all have answered or its deadline has passed, and the ego fuses what has come. Requests take no
time; the ego's work begins when a frame is closed.

What the live ego does is done here by the same rules: a robot that is late, or has as many requests
under way as it may have, is `busy`; late answers are carried and dropped; an answer that would take
the link too long is `refused`; frames that would only wait for their turn are not asked for.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from ego_agent.execute.ask import MAX_TRANSFER_S, MIN_PAYLOAD_BYTES, REQUESTS_UNDER_WAY
from ego_agent.execute.frame_round import LATE_S, MissingKind
from ego_agent.execute.pipeline import LEARNT, MAX_FRAMES
from ego_agent.knowledge.compute import Work
from research.evaluation.windows.cell import Cell
from research.evaluation.windows.processors import Agenda, Processors
from research.evaluation.windows.timing import Conditions, Played, PlayedFrame

Sizes = Callable[[str, int], int]
"""Bytes of a robot's answer in a frame, by its number in the window."""


def play(robots: Sequence[str], frames: int, sizes: Sizes, conditions: Conditions) -> Played:
    """Plays a window of so many frames with these participants, the ego apart.

    It begins with nothing under way. Equal calls have equal results.
    """
    return _Play(robots, frames, sizes, conditions).run()


@dataclass(slots=True, eq=False)
class _Round:
    """One frame that robots were asked for."""

    number: int
    begun_s: float
    works: Mapping[str, Work]
    """What the answer of each takes that was to be asked."""
    waiting: set[str]
    missing: dict[str, MissingKind]
    in_time: list[str] = field(default_factory=list)
    closed_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Request:
    """One robot's part of a round."""

    robot: str
    round: _Round
    size: int
    refused: bool
    """Its answer would take the link too long."""


class _Play:
    def __init__(
        self, robots: Sequence[str], frames: int, sizes: Sizes, conditions: Conditions
    ) -> None:
        self._robots = robots
        self._sizes = sizes
        self._with = conditions
        self._agenda = agenda = Agenda()
        number = conditions.processors
        shared = Processors(agenda, number) if number is not None else None
        self._ego = shared or Processors(agenda, 1)
        self._processor = {robot: shared or Processors(agenda, 1) for robot in robots}
        self._own = {
            robot: Cell(partial(_always, bps)) for robot, bps in conditions.own_bps.items()
        }
        self._cell = Cell(conditions.cell_bps)
        self._owing: dict[str, list[_Request]] = {robot: [] for robot in robots}
        self._unread: dict[str, list[_Request]] = {robot: [] for robot in robots}
        """Requests that a robot has not begun to encode."""
        self._encoding: set[str] = set()
        self._prompt: set[str] = set()
        """Robots whose newest answer came in time."""
        self._newest = -1
        """Number of the newest frame that was asked for."""
        self._turns: deque[_Round] = deque()
        """Frames under way; the first has its turn."""
        self._turn_s = 0.0
        """Since when."""
        self._fusing = False
        self._answer_s = self._fuse_s = 0.0
        """Expected, as in the live pipeline."""
        self._frames: list[PlayedFrame | None] = [None] * frames
        self._sent_bytes = 0

    def run(self) -> Played:
        for number in range(len(self._frames)):
            self._agenda.at(number * self._with.period_s, self._look)
        self._agenda.run()
        return Played(tuple(self._frames), self._sent_bytes)

    def _look(self) -> None:
        """Asks for the newest frame, if it is a new one and would not only wait for its turn."""
        now_s = self._agenda.now_s
        newest = math.floor(now_s / self._with.period_s + 1e-9)
        if self._newest < newest < len(self._frames):
            full_s = self._full_for_s(now_s)
            if full_s <= 1e-9:
                self._newest = newest
                self._ask(newest)
            elif math.isfinite(full_s):
                self._agenda.at(now_s + full_s, self._look)

    def _full_for_s(self, now_s: float) -> float:
        """See ego_agent.execute.pipeline.Pipeline.full_for_s."""
        if not self._turns:
            return 0.0
        if len(self._turns) >= MAX_FRAMES:
            return math.inf
        free_s = self._turn_s
        for one in self._turns:
            answered_s = one.begun_s + self._answer_s if one.closed_s is None else one.closed_s
            free_s = max(free_s, answered_s) + self._fuse_s
        return free_s - self._answer_s - now_s

    def _ask(self, number: int) -> None:
        now_s = self._agenda.now_s
        works = self._works(number)
        asked = {robot for robot in works if not self._is_busy(robot)}
        busy: dict[str, MissingKind] = {robot: "busy" for robot in works if robot not in asked}
        one = _Round(number, now_s, works, asked, busy)
        if not self._turns:
            self._turn_s = now_s
        self._turns.append(one)
        share_bps = self._with.cell_bps(now_s) / max(1, len(asked))
        for robot in [robot for robot in self._robots if robot in asked]:
            own_bps = min(share_bps, self._with.own_bps.get(robot, math.inf))
            most = max(MIN_PAYLOAD_BYTES, own_bps / 8.0 * MAX_TRANSFER_S)
            size = self._sizes(robot, number)
            request = _Request(robot, one, size, refused=size > most)
            self._owing[robot].append(request)
            self._unread[robot].append(request)
            self._read(robot)
        self._agenda.at(now_s + self._with.deadline_s, partial(self._deadline, one))
        self._close_if_answered(one)

    def _works(self, number: int) -> Mapping[str, Work]:
        """Who is to be asked for a frame, and what each answer takes."""
        if self._with.asked is None:
            return dict.fromkeys(self._robots, self._with.work)
        return self._with.asked[number]

    def _is_busy(self, robot: str) -> bool:
        """See ego_agent.execute.ask.Asker."""
        now_s, deadline_s = self._agenda.now_s, self._with.deadline_s
        given_up_s = 2.0 * (deadline_s + LATE_S)
        ages_s = [now_s - request.round.begun_s for request in self._owing[robot]]
        owed_s = [age_s for age_s in ages_s if age_s < given_up_s]
        most = REQUESTS_UNDER_WAY if robot in self._prompt else 1
        return len(owed_s) >= most or any(age_s >= deadline_s - 1e-9 for age_s in owed_s)

    def _read(self, robot: str) -> None:
        """Lets a robot that does not encode take its newest request; a robot encodes one answer at
        a time."""
        if robot in self._encoding or not self._unread[robot]:
            return
        request = self._unread[robot].pop()
        if self._agenda.now_s - request.round.begun_s > self._with.deadline_s + LATE_S:
            # Its asker has stopped waiting.
            self._settle(request)
            return
        self._encoding.add(robot)
        encode_s = 1e-3 * request.round.works[robot].encode_ms
        self._processor[robot].work(encode_s, partial(self._encoded, request))

    def _encoded(self, request: _Request) -> None:
        robot, now_s = request.robot, self._agenda.now_s
        self._encoding.discard(robot)
        if request.refused:
            self._settle(request)
            self._prompt.discard(robot)
            if robot in request.round.waiting:
                request.round.waiting.discard(robot)
                request.round.missing[robot] = "refused"
                self._close_if_answered(request.round)
        elif robot in self._own:
            there_s = self._own[robot].send(now_s, request.size)
            if math.isfinite(there_s):
                self._agenda.at(there_s, partial(self._at_cell, request))
        else:
            self._at_cell(request)
        self._read(robot)

    def _at_cell(self, request: _Request) -> None:
        through_s = self._cell.send(self._agenda.now_s, request.size)
        if math.isfinite(through_s):
            self._sent_bytes += request.size
            self._agenda.at(through_s, partial(self._arrived, request))

    def _arrived(self, request: _Request) -> None:
        robot, one = request.robot, request.round
        self._settle(request)
        if robot not in one.waiting:
            self._prompt.discard(robot)
            return
        self._prompt.add(robot)
        one.waiting.discard(robot)
        one.in_time.append(robot)
        self._close_if_answered(one)

    def _settle(self, request: _Request) -> None:
        self._owing[request.robot] = [
            owed for owed in self._owing[request.robot] if owed is not request
        ]

    def _deadline(self, one: _Round) -> None:
        one.missing.update(dict.fromkeys(sorted(one.waiting), "deadline"))
        one.waiting.clear()
        self._close_if_answered(one)

    def _close_if_answered(self, one: _Round) -> None:
        if not one.waiting and one.closed_s is None:
            one.closed_s = self._agenda.now_s
            self._fuse()

    def _fuse(self) -> None:
        """Fuses the frame that has its turn, when it is closed."""
        if self._fusing or not self._turns or self._turns[0].closed_s is None:
            return
        self._fusing = True
        one = self._turns[0]
        added_ms = sum(one.works[robot].add_ms for robot in one.in_time)
        self._ego.work(1e-3 * (self._with.work.fixed_ms + added_ms), self._fused)

    def _fused(self) -> None:
        one, now_s = self._turns.popleft(), self._agenda.now_s
        assert one.closed_s is not None
        self._frames[one.number] = PlayedFrame(
            one.number, tuple(sorted(one.in_time)), one.missing, now_s - one.begun_s
        )
        took_s = now_s - max(one.closed_s, self._turn_s)
        self._fuse_s += LEARNT * (took_s - self._fuse_s)
        self._answer_s += LEARNT * (one.closed_s - one.begun_s - self._answer_s)
        self._fusing, self._turn_s = False, now_s
        self._look()
        self._fuse()


def _always(bps: float, _: float) -> float:
    return bps
