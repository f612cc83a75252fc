"""What a choice (P, a) would bring and cost in one scene: Q(P, a) and C(P, a)."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.answers import UNTRIED
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, UnifiedScene
from ego_agent.knowledge.own_costs import LIGHTER
from ego_agent.knowledge.pace import USUAL, Pace, paces
from ego_agent.knowledge.quality import QualityModel
from ego_agent.plan.choices.union import Union, Views
from swarm.messages import Algorithm, Assignment

ARRIVAL_STEPS = 20
"""Probabilities to be in time count in steps of 1/20: a frame more or less moves no decision, and
what is nearly always in time counts as certain."""

PREFERRED = 0.02
"""Quality that may be given up for each preferred robot that takes part: a `switch_gain`."""
LIKED = 2.0
"""A preferred robot is tried before one that adds less than this many times as much."""


@dataclass(frozen=True, slots=True)
class Score:
    """One choice and its prediction."""

    participants: tuple[str, ...]
    """Without the ego, nearest first."""
    algorithm: Algorithm
    quality: float
    """Q(P, a) in [0, 1]."""
    cost_bytes: int
    """Bytes of one fused frame over all participants but the ego."""
    value: float
    """Q - lambda C."""
    pace: Pace = USUAL
    assignments: tuple[Assignment, ...] = ()
    """What each participant sends, and how often, where that is not the same of all in every fused
    frame; the algorithm is MIXED where that differs, and the bytes are the mean of a frame."""

    def algorithm_of(self, robot: str) -> Algorithm:
        """What a participant sends."""
        forms = (one.algorithm for one in self.assignments if one.robot == robot)
        return next(forms, self.algorithm)

    @property
    def sends(self) -> dict[str, Algorithm]:
        """What each participant sends."""
        return {robot: self.algorithm_of(robot) for robot in self.participants}

    @property
    def cost(self) -> float:
        """lambda C, in quality."""
        return self.quality - self.value


class Scorer:
    """Scores choices in one scene, at one pace: the fastest, unless `at` says otherwise.

    Row 0 of its arrays is the ego, row i the (i-1)th candidate.
    """

    def __init__(
        self,
        scene: UnifiedScene,
        knowledge: Knowledge,
        *,
        budget_bytes: int | None = None,
        hopes: bool = False,
    ) -> None:
        """`budget_bytes` is what a fused frame may cost; by default what C(t) carries. `hopes`:
        everyone counts as in time, whatever has been learnt."""
        self.scene = scene
        self.knowledge = knowledge
        self.objective = knowledge.objective
        self.paces = paces(self.objective)
        """Fastest first."""
        self.pace = self.paces[0]
        if budget_bytes is None:
            budget_bytes = self.objective.budget_bytes(scene.capacity_bps)
        self.budget_bytes = budget_bytes
        self.hopes = hopes
        self._arrival: dict[Algorithm, NDArray[np.float64]] = {}
        self._prices: dict[tuple[int, Algorithm], float] = {}
        self._able: dict[Algorithm, NDArray[np.intp]] = {}
        self._at: dict[Pace, Scorer] = {self.pace: self}
        """The scorers of all paces that were asked for; they share it."""
        robots = (scene.ego, *scene.candidates)
        self.row_of = {c.robot: row for row, c in enumerate(robots)}
        cells, things = _counting(scene, knowledge.quality)
        everyone = (*robots, *scene.unheard, *scene.left_out)
        shown = np.stack([c.area for c in everyone]) & cells
        told = np.stack([c.evidence for c in everyone]).astype(np.float64) * things
        areas, evidence = shown[: len(robots)], told[: len(robots)]
        weights = scene.weights
        if weights is None:
            area = float(shown.any(axis=0).sum())
            objects = float(told.max(axis=0).sum())
        else:
            area = float(weights.cells[shown.any(axis=0)].sum(dtype=np.float64))
            objects = float(told.max(axis=0) @ weights.objects)
        alpha = self.objective.alpha if objects > 0.0 else 1.0
        if area == 0:
            alpha = 0.0
        self.known_part = _known_part(scene)
        """Of the living robots, the part of which something is known."""
        area_weight = self.known_part * alpha / area if area else 0.0
        object_weight = self.known_part * (1.0 - alpha) / objects if objects > 0.0 else 0.0
        self.views = Views(areas, evidence, area_weight, object_weight, weights)
        self.nothing_to_see = area == 0 and objects == 0.0
        self.own_share = self.share([0])
        """Of the ego alone."""

    def at(self, pace: Pace) -> Scorer:
        """The same scene at another pace."""
        known = self._at.get(pace)
        if known is None:
            known = copy.copy(self)
            known.pace = pace
            known.budget_bytes = self.objective.budget_bytes(self.scene.capacity_bps, pace.rate_hz)
            known._arrival, known._prices, known._able = {}, {}, {}
            self._at[pace] = known
        return known

    def at_rate(self, rate_hz: float | None) -> Scorer:
        """The same scene at the pace with that rate; the fastest where there is none."""
        found = (pace for pace in self.paces if pace.rate_hz == rate_hz)
        return self.at(next(found, self.paces[0]))

    def arrival(self, algorithm: Algorithm) -> NDArray[np.float64]:
        """Probability that each row's observation is in time and in its place, float64 (rows,); the
        ego's is 1."""
        known = self._arrival.get(algorithm)
        if known is None:
            chances = [1.0, *(self._arrives(c, algorithm) for c in self.scene.candidates)]
            known = np.round(np.array(chances) * ARRIVAL_STEPS) / ARRIVAL_STEPS
            self._arrival[algorithm] = known
        return known

    def counting(self, algorithm: Algorithm) -> NDArray[np.float64]:
        """Probability that each row's observation is there and suffices for what it shows,
        float64 (rows,); the ego's is 1."""
        counts = self.arrival(algorithm) * self.knowledge.convinces(algorithm)
        counts[0] = 1.0
        return counts

    def in_time(self, robot: str, algorithm: Algorithm) -> float:
        """Probability that a candidate's observation is in time."""
        if self.hopes:
            return 1.0
        answers = self.scene.candidates[self.row_of[robot] - 1].answers
        return answers.get(algorithm, UNTRIED).in_time(self.pace.deadline_s)

    def _arrives(self, candidate: Candidate, algorithm: Algorithm) -> float:
        placed = 1.0 if self.hopes else candidate.placed
        return placed * self.in_time(candidate.robot, algorithm)

    def share(self, rows: Collection[int], algorithm: Algorithm | None = None) -> float:
        """The part of all that any living robot could show that these rows, the ego first, see, in
        [0, 1].

        With an algorithm the part that is expected to arrive in time; else as if all did. 1 when
        nobody sees anything: then nobody can add anything to the ego. 0 when it is unknown: none of
        the living robots can be used, or the ego does not know where it is itself.
        """
        if self.nothing_to_see:
            return self.known_part
        first, *others = rows
        counts = None if algorithm is None else self.counting(algorithm)
        union = Union(self.views, first)
        for row in others:
            union.add(row, 1.0 if counts is None else float(counts[row]))
        return min(1.0, union.share())

    def liking(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """By how much the gains of rows count in the order in which robots are tried."""
        robots = [self.scene.candidates[row - 1].robot for row in rows]
        return np.array([LIKED if robot in self.scene.preferred else 1.0 for robot in robots])

    def known(self, robot: str, algorithm: Algorithm) -> bool:
        """Whether the robot is a candidate with a known size for the algorithm."""
        row = self.row_of.get(robot, 0)
        return row > 0 and algorithm in self.scene.candidates[row - 1].sizes

    def can(self, robot: str, algorithm: Algorithm) -> bool:
        """Whether the robot is a candidate with a known size for the algorithm, and its own link
        carries that at the fusion rate."""
        return self.known(robot, algorithm) and (
            self.needs_bps(robot, algorithm) <= self.allowed_bps(robot)
        )

    def able(self, algorithm: Algorithm) -> NDArray[np.intp]:
        """Rows of those that `can`, by robot id."""
        known = self._able.get(algorithm)
        if known is None:
            robots = sorted(c.robot for c in self.scene.candidates if self.can(c.robot, algorithm))
            known = np.array([self.row_of[robot] for robot in robots], dtype=np.intp)
            self._able[algorithm] = known
        return known

    def needs_bps(self, robot: str, algorithm: Algorithm) -> float:
        """bit/s of a robot's own link that its observations take, beside what it sends to other
        egos anyway. Raises KeyError where `known` is false."""
        if self._is_shared(robot, algorithm):
            return 0.0
        return self.size(robot, algorithm) * 8.0 * self.pace.rate_hz

    def _is_shared(self, robot: str, algorithm: Algorithm) -> bool:
        return algorithm in self.scene.candidates[self.row_of[robot] - 1].shared

    def allowed_bps(self, robot: str) -> float:
        """bit/s that observations may take of a candidate's own link; may be infinite."""
        capacity_bps = self.scene.candidates[self.row_of[robot] - 1].capacity_bps
        return self.objective.headroom * capacity_bps

    def size(self, robot: str, algorithm: Algorithm) -> int:
        """Bytes of one observation. Raises KeyError where `known` is false."""
        return self.scene.candidates[self.row_of[robot] - 1].sizes[algorithm]

    def score(self, participants: Iterable[str], algorithm: Algorithm) -> Score:
        """The score of candidates (the ego is always part of it) with an available algorithm.

        Raises KeyError for a robot whose size for this algorithm is not `known`.
        """
        rows = sorted({self.row_of[r] for r in participants} - {0})
        chosen = tuple(self.scene.candidates[row - 1].robot for row in rows)
        share = self.share([0, *rows], algorithm)
        size = sum(self.size(robot, algorithm) for robot in chosen)
        return self.score_of(chosen, algorithm, share, size, self.cost(chosen, algorithm))

    def score_of(
        self,
        participants: tuple[str, ...],
        algorithm: Algorithm,
        share: float,
        size: int,
        cost: float,
    ) -> Score:
        """The score of a choice whose expected share, bytes and lambda C are known already."""
        quality = self.quality(algorithm, share, len(participants))
        return Score(participants, algorithm, quality, size, quality - cost, self.pace)

    def quality(self, algorithm: Algorithm, share: float, participants: int) -> float:
        """Q of so many participants that show that share of all, the ego's included."""
        quality = self.knowledge.quality.quality(
            algorithm, self.own_share, min(1.0, share), self.known_part
        )
        return quality * self.freshness(algorithm, participants)

    def cost(self, participants: Iterable[str], algorithm: Algorithm) -> float:
        """lambda C of candidates, in quality: a sum over them, less what preferred may cost."""
        prices = (
            self.price(self.row_of[robot], algorithm)
            - (PREFERRED if robot in self.scene.preferred else 0.0)
            for robot in participants
        )
        return sum(prices)

    def price(self, row: int, algorithm: Algorithm) -> float:
        """lambda C of one candidate. Raises KeyError where its size is not `known`.

        The ego goes on measuring its own work: all choices of one scene are priced alike.
        """
        price = self._prices.get((row, algorithm))
        if price is None:
            price = self._priced(row, algorithm, objects_only=False)
            self._prices[row, algorithm] = price
        return price

    def objects_price(self, row: int, algorithm: Algorithm) -> float:
        """The same where it sends only what may be an object."""
        return self._priced(row, algorithm, objects_only=True)

    def _priced(self, row: int, algorithm: Algorithm, *, objects_only: bool) -> float:
        candidate = self.scene.candidates[row - 1]
        compute_s = self.knowledge.work_s(algorithm)
        if algorithm not in candidate.shared:
            compute_s += self._encode_s(row, algorithm)
        size = candidate.contribution_size(algorithm, objects_only=objects_only)
        return self._cost(size, compute_s)

    def places_price(self, row: int, algorithm: Algorithm) -> float:
        """The same of asking about places in every fused frame."""
        compute_s = LIGHTER * self.knowledge.work_s(algorithm) + self._encode_s(row, algorithm)
        return self._cost(self.scene.candidates[row - 1].places_size(algorithm), compute_s)

    def _encode_s(self, row: int, algorithm: Algorithm) -> float:
        answers = self.scene.candidates[row - 1].answers
        return self.knowledge.encode_s(algorithm, answers.get(algorithm, UNTRIED).work_s)

    def _cost(self, size: int, compute_s: float) -> float:
        capacity_bps = self.scene.capacity_bps
        return self.objective.cost(size, capacity_bps, compute_s, self.pace.rate_hz)

    def most(self, algorithm: Algorithm) -> float:
        """More quality than any choice with this algorithm has at this pace."""
        share = self.share([0, *self.able(algorithm).tolist()], algorithm)
        return self.quality(algorithm, share, 0)

    def slower_is_worse(self, algorithm: Algorithm) -> bool:
        """Whether no slower pace can bring anything: the link carries everyone at this one, and
        nobody is in time more often where there is more time."""
        able = self.able(algorithm).tolist()
        sizes = [self.scene.candidates[row - 1].sizes[algorithm] for row in able]
        known = sum(algorithm in c.sizes for c in self.scene.candidates)
        if len(able) < known or sum(sizes) > self.budget_bytes:
            return False
        patient = self.at(self.paces[-1])
        return bool(np.array_equal(self.arrival(algorithm), patient.arrival(algorithm)))

    def freshness(self, algorithm: Algorithm, participants: int) -> float:
        """What results at this pace are worth against those at the fastest, in (0, 1]."""
        if not self.knowledge.learns:
            return 1.0
        frame_s = self.knowledge.own_costs.frame_s(algorithm, participants)
        return self.pace.freshness(self.paces[0], frame_s)

    def fits(self, score: Score) -> bool:
        """Whether the link can carry the choice at the pace."""
        return score.cost_bytes <= self.budget_bytes

    def good_enough(self, score: Score) -> bool:
        """Q >= Q_min."""
        return score.quality >= self.objective.q_min


def _counting(
    scene: UnifiedScene, quality: QualityModel
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which cells, bool (G, G), and which objects, bool (K,), count: those in the area around the
    ego in which quality is measured."""
    pose, side = scene.ego.pose, len(scene.ego.area)
    middles = (np.arange(side) + 0.5 - side // 2) * scene.cell_m
    x, y = np.meshgrid(middles, middles)
    cells = quality.counts(np.column_stack([x.ravel(), y.ravel()]), pose.heading)
    ego = np.array([pose.x, pose.y])
    objects = quality.counts(scene.objects[:, :2].astype(np.float64) - ego, pose.heading)
    return cells.reshape(side, side), objects


def _known_part(scene: UnifiedScene) -> float:
    """The part of the living robots of which something is known, the ego among them; 0 where
    nobody can be used."""
    silent = len(scene.unheard) + scene.unknown
    usable = scene.candidates or scene.left_out
    if scene.ego.robot in scene.excluded or (silent and not usable):
        return 0.0
    heard = (scene.ego, *scene.candidates, *scene.unheard, *scene.left_out)
    known = {candidate.robot for candidate in heard}
    return len(known) / (len(known) + scene.unknown)
