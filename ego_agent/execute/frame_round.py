"""One frame that robots were asked for: what came of each, and what it brought."""

from __future__ import annotations

import queue
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from perception.codec.places import Places
from perception.fusion.base import Contribution, FrameRequest
from swarm.messages import Algorithm

LATE_S = 1.25
"""How long after the deadline an answer may still come; its bytes are counted then."""
MissingKind = Literal[
    "offline", "left", "busy", "deadline", "refused", "invalid", "unanswered", "skew", "rejected",
    "probe", "impostor", "unplaced",
]  # fmt: skip
MISSING_KINDS: tuple[MissingKind, ...] = get_args(MissingKind)


@dataclass(frozen=True, slots=True)
class Missing:
    """Why a chosen robot is not in a fused frame."""

    kind: MissingKind
    detail: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.detail}"


@dataclass(frozen=True, slots=True)
class Question:
    """What a robot is asked for in a frame."""

    algorithm: Algorithm
    tell: FrameRequest = field(default_factory=FrameRequest)
    """What it must know to encode."""
    rate_hz: float = 10.0
    """How often it is asked for it."""
    shares: bool = False
    """Whether the ego would take what it publishes for several."""
    focused: bool = False
    """Whether it is asked about places only, for what the ego remembers there."""


@dataclass(slots=True, eq=False)
class FrameRound:
    """The requests of one frame. The asking thread writes it; until the frame's time is over, other
    threads only read `contributions_in_turn`."""

    questions: Mapping[str, Question]
    """By robot."""
    begun_at: float
    deadline_s: float
    contributions: list[Contribution] = field(default_factory=list)
    bytes: dict[str, int] = field(default_factory=dict)
    """Payload bytes of the contributions that arrived in time, by robot."""
    missing: dict[str, Missing] = field(default_factory=dict)
    """Robots without a contribution."""
    waiting: set[str] = field(default_factory=set)
    asked_at: dict[str, float] = field(default_factory=dict)
    """When each robot was asked, `time.monotonic()` seconds like all times here."""
    arrived_at: dict[str, float] = field(default_factory=dict)
    """When each robot's answer was there, also one that was late."""
    encode_ms: dict[str, float] = field(default_factory=dict)
    """How long each contribution's robot took to encode it."""
    capacity_bps: float = 1.0
    """C(t) when it began."""
    probe: bool = False
    """It is asked for the sake of its time: nobody fuses what comes."""
    closed_at: float | None = None
    """When the last robot had answered or the deadline had passed; None until then."""
    _arrived: queue.SimpleQueue[Contribution | None] = field(default_factory=queue.SimpleQueue)
    _late: queue.SimpleQueue[Contribution] = field(default_factory=queue.SimpleQueue)

    def algorithm_of(self, robot: str) -> Algorithm:
        """What a robot was asked for."""
        return self.questions[robot].algorithm

    def focused(self, robots: Iterable[str]) -> frozenset[str]:
        """Those of some robots that were asked about places only."""
        return frozenset(robot for robot in robots if self.questions[robot].focused)

    def objects_only(self, robots: Iterable[str]) -> frozenset[str]:
        """Those of some robots that were asked only for what may be an object."""
        return frozenset(robot for robot in robots if self.questions[robot].tell.objects_only)

    @property
    def places(self) -> Places:
        """Those that robots were asked about; empty where none was asked about places only."""
        return next((one.tell.demand for one in self.questions.values() if one.focused), b"")

    @property
    def is_mixed(self) -> bool:
        """Whether robots were asked for different forms."""
        return len({question.algorithm for question in self.questions.values()}) > 1

    @property
    def due_at(self) -> float:
        """When the deadline passes."""
        return self.begun_at + self.deadline_s

    @property
    def given_up_at(self) -> float:
        """When no answer can come any more: a second try may end as late as this."""
        return self.begun_at + 2.0 * (self.deadline_s + LATE_S)

    def outcome(self, robot: str) -> str:
        """What came of a robot in a closed round: `in_time`, or one of MISSING_KINDS."""
        return self.missing[robot].kind if robot in self.missing else "in_time"

    def contributions_in_turn(self) -> Iterator[Contribution]:
        """Each contribution when it arrives, until the round is closed. For one caller."""
        while (contribution := self._arrived.get()) is not None:
            yield contribution

    def take(self, contribution: Contribution) -> None:
        """Adds what came in time."""
        self.contributions.append(contribution)
        self._arrived.put(contribution)

    def take_late(self, contribution: Contribution) -> None:
        """Adds what came after the deadline."""
        self._late.put(contribution)

    def late_contributions(self) -> list[Contribution]:
        """What came after the deadline since this was asked last. For one thread."""
        found = []
        while not self._late.empty():
            found.append(self._late.get())
        return found

    def close(self, now: float) -> None:
        """Ends the waiting."""
        for robot in sorted(self.waiting):
            self.missing[robot] = Missing("deadline", f"no answer within {self.deadline_s:g} s")
        self.waiting.clear()
        self.closed_at = now
        self._arrived.put(None)
