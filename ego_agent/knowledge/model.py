"""The values that pass between the stages of a control cycle.

Monitor makes a `Snapshot`; Analyze makes a `UnifiedScene` of it; a policy makes a `Proposal` of
that; validation makes the `messages.Decision` that Execute carries out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.answers import AnswerTimes
from ego_agent.knowledge.pace import EVERYTHING
from swarm.geometry import Pose
from swarm.messages import (
    AdviceReport,
    Algorithm,
    Assignment,
    Beacon,
    SceneDescription,
    Source,
)


@dataclass(frozen=True, slots=True)
class RobotView:
    """What the ego knows of one robot at the start of a cycle. Ages are ages of what was sensed, on
    the ego's own clock: a message that queued is old."""

    robot: str
    alive: bool
    """Its liveliness token is present."""
    beacon: Beacon | None
    """With the frame and the pose of its newest answer, where that is younger."""
    beacon_age_s: float
    scene: SceneDescription | None
    scene_age_s: float
    round_trip_s: float | None
    """Smoothed time from query to answer; None before the first answer."""
    clock_offset_s: float
    """Robot's time of day minus the ego's."""
    duplicate: bool
    """Two processes use this id at the same time."""
    capacity_bps: float = math.inf
    """What its own link delivers, where that is known to be less than the cell does."""
    delay_s: float = 0.0
    """How long its newest beacon was on its way."""
    unheard_s: float = 0.0
    """Since its last beacon came, whatever its answers have told since."""
    misfit: str = ""
    """Why what it says is of no use here, as the rest of a sentence: another world, another version
    of the messages; empty where it fits."""
    off_duty: str = ""
    """Of the ego itself: who keeps its robot out of the swarm; empty while nobody does."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything Monitor knows at the start of one cycle. The ego itself is one of `robots`."""

    ego: str
    cycle: int
    now_ns: int
    robots: Mapping[str, RobotView]
    capacity_bps: float
    """C(t), the estimate of what the ego's link delivers."""
    capacity_source: str
    """`measured`, `net/state` or `prior`."""
    capacity_error: float | None = None
    """Share by which what was measured is off what a fresh `net/state` says; None without both."""

    @property
    def capacity_is_configured(self) -> bool:
        """Whether C(t) is what a controller says, not a guess."""
        return self.capacity_source == "net/state"


PART, MOST_PART = 0.25, 0.7
"""Of a whole observation's bytes, what an answer about places has before any came, and what makes
it no smaller."""
OBJECTS_PART, MOST_OBJECTS_PART = 0.6, 0.9
"""The same of an observation of what may be an object."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A robot that may take part: known, alive, fresh, unique and in range."""

    robot: str
    pose: Pose
    distance_m: float
    sizes: Mapping[Algorithm, int]
    """Bytes of one observation by algorithm, of those that this swarm can fuse."""
    area: NDArray[np.bool_]
    """(G, G) cells of the unified grid that the robot sees."""
    evidence: NDArray[np.float32]
    """(K,) how well the robot sees each unified object, in [0, 1]."""
    capacity_bps: float = math.inf
    """What its own link delivers, where that is known to be less than C(t)."""
    answers: Mapping[Algorithm, AnswerTimes] = field(default_factory=dict)
    """How long its answers take, as far as anything is known."""
    placed: float = 1.0
    """Probability that what it sends can be laid where it belongs, as far as anything is known."""
    shared: frozenset[Algorithm] = frozenset()
    """What it sends anyway, for other egos: this one's part takes nothing of it."""
    focused: Mapping[Algorithm, int] = field(default_factory=dict)
    """Bytes of its answers about places, as far as any has come..."""
    objects: Mapping[Algorithm, int] = field(default_factory=dict)
    """...and of its observations of what may be an object."""

    def places_size(self, algorithm: Algorithm) -> int:
        """Bytes of an answer about places, as they came or as they are expected. Raises KeyError
        where no size of the algorithm is known."""
        known = self.focused.get(algorithm)
        return math.ceil(PART * self.sizes[algorithm]) if known is None else known

    def contribution_size(self, algorithm: Algorithm, *, objects_only: bool) -> int:
        """Bytes of one observation, of everything or, but for one of some, of what may be an object
        only, on average, as they came or as they are expected. Raises KeyError where no size of the
        algorithm is known."""
        whole = self.sizes[algorithm]
        if not objects_only:
            return whole
        return math.ceil((whole + (EVERYTHING - 1) * self._objects_size(algorithm)) / EVERYTHING)

    def sends_objects(self, algorithm: Algorithm) -> bool:
        """Whether its observations of what may be an object are smaller than others, as far as is
        known: a robot of an older program, or one that is to keep all points, sends them all."""
        return self._objects_size(algorithm) < MOST_OBJECTS_PART * self.sizes[algorithm]

    def _objects_size(self, algorithm: Algorithm) -> float:
        return self.objects.get(algorithm, OBJECTS_PART * self.sizes[algorithm])

    def tells_places(self, algorithm: Algorithm) -> bool:
        """Whether its answers about places are smaller than others, as far as is known: a robot of
        an older program sends its whole scan."""
        return self.places_size(algorithm) < MOST_PART * self.sizes[algorithm]


@dataclass(frozen=True, slots=True)
class Weights:
    """How much what is seen counts, where not all counts alike: numbers above 0."""

    cells: NDArray[np.float32]
    """(G, G)."""
    objects: NDArray[np.float32]
    """(K,)."""


@dataclass(frozen=True, slots=True)
class UnifiedScene:
    """One scene from all robots' descriptions, on a square grid centred on the ego."""

    ego: Candidate
    candidates: tuple[Candidate, ...]
    """Without the ego, nearest first."""
    excluded: Mapping[str, str]
    """Robots that may not take part, and why; the ego too where its own state is not known."""
    objects: NDArray[np.float32]
    """(K, 3) merged object centroids, world frame, metres."""
    cell_m: float
    capacity_bps: float
    unheard: tuple[Candidate, ...] = ()
    """Living robots in range that are excluded or whose scene is old, as they were last seen: what
    they could show counts in what all could."""
    unknown: int = 0
    """Such robots of which nothing tells what they could show."""
    left_out: tuple[Candidate, ...] = ()
    """Who may not take part by an operator's intent: what they could show counts in what all
    could."""
    weights: Weights | None = None
    """None: every cell and every object counts alike."""
    preferred: frozenset[str] = frozenset()
    """Candidates that an operator would rather have."""

    def is_whole(self) -> bool:
        """Whether somebody is there, and nobody is unheard."""
        return bool(self.candidates) and not self.unheard and not self.unknown


@dataclass(frozen=True, slots=True)
class Proposal:
    """What a policy wants; nothing in it is trusted until it has been validated."""

    participants: tuple[str, ...]
    algorithm: str
    reason: str
    source: Source
    made_ns: int | None = None
    """When the scene that it was made from was taken, on the ego's clock; None: in this cycle."""
    model: str = ""
    """The language model that proposed it."""
    notes: tuple[str, ...] = ()
    """What was changed or refused on the way to it, one sentence each; goes before `repairs`."""
    advice: AdviceReport | None = None
    """How the policy stands with its language model, where it has one."""
    rate_hz: float | None = None
    """Frames a second; None leaves the best pace to validation."""
    assignments: tuple[Assignment, ...] = ()
    """What each participant but the ego shall send, and how often; empty: all the same, in every
    frame."""
    compared: object = field(default=None, repr=False, compare=False)
    """What it was chosen from, for those who tell why: `plan.choices.options.Compared`, or None
    where the policy compares otherwise."""
