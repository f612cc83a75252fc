"""What a choice (P, a) would bring and cost in one scene: Q(P, a) and C(P, a)."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge import Knowledge
from ego_agent.model import UnifiedScene
from swarm.messages import Algorithm


@dataclass(frozen=True, slots=True)
class Score:
    """One choice and its prediction."""

    participants: tuple[str, ...]
    """Without the ego, nearest first."""
    algorithm: Algorithm
    quality: float
    """Q(P, a) in [0, 1]."""
    cost_bytes: int
    """C(P, a): bytes of one fused frame over all participants but the ego."""
    value: float
    """Q - lambda C."""


class Scorer:
    """Scores choices in one scene.

    Row 0 of its arrays is the ego, row i the (i-1)th candidate; area masks are packed into 64-bit
    words, so that a union of 20,000 cells takes microseconds.
    """

    def __init__(
        self, scene: UnifiedScene, knowledge: Knowledge, *, budget_bytes: int | None = None
    ) -> None:
        """`budget_bytes` is what a fused frame may cost; by default what C(t) carries."""
        self.scene = scene
        self.knowledge = knowledge
        self.objective = knowledge.objective
        if budget_bytes is None:
            budget_bytes = self.objective.budget_bytes(scene.capacity_bps)
        self.budget_bytes = budget_bytes
        robots = (scene.ego, *scene.candidates)
        self.row_of = {c.robot: row for row, c in enumerate(robots)}
        self.bits = pack_areas(np.stack([c.area for c in robots]))
        self.evidence = np.stack([c.evidence for c in robots]).astype(np.float64)
        area = int(np.bitwise_count(np.bitwise_or.reduce(self.bits, axis=0)).sum())
        objects = float(self.evidence.max(axis=0).sum())
        alpha = self.objective.alpha if objects > 0.0 else 1.0
        if area == 0:
            alpha = 0.0
        self._area_weight = alpha / area if area else 0.0
        self._object_weight = (1.0 - alpha) / objects if objects > 0.0 else 0.0
        self.nothing_to_see = area == 0 and objects == 0.0

    def share(self, rows: Collection[int]) -> float:
        """The part of all that anyone sees that these rows see, in [0, 1].

        1 when nobody sees anything: then nobody can add anything to the ego.
        """
        if self.nothing_to_see:
            return 1.0
        picked = list(rows)
        bits = np.bitwise_or.reduce(self.bits[picked], axis=0)
        evidence = self.evidence[picked].max(axis=0)
        seen = self._area_weight * int(np.bitwise_count(bits).sum())
        return min(1.0, seen + self._object_weight * float(evidence.sum()))

    def gains(
        self, rows: NDArray[np.intp], bits: NDArray[np.uint64], evidence: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """What each of the rows adds to the share of a union that already has `bits` (words) and
        `evidence` (objects,): float64 (rows,)."""
        cells = np.bitwise_count(self.bits[rows] & ~bits).sum(axis=1, dtype=np.int64)
        objects = np.maximum(self.evidence[rows] - evidence, 0.0).sum(axis=1)
        added: NDArray[np.float64] = self._area_weight * cells + self._object_weight * objects
        return added

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

    def needs_bps(self, robot: str, algorithm: Algorithm) -> float:
        """bit/s of a robot's observations. Raises KeyError where `known` is false."""
        return self.size(robot, algorithm) * 8.0 * self.objective.rate_hz

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
        share = self.share([0, *rows])
        cost = sum(self.size(robot, algorithm) for robot in chosen)
        return self.score_of(chosen, algorithm, share, cost)

    def score_of(
        self, participants: tuple[str, ...], algorithm: Algorithm, share: float, cost: int
    ) -> Score:
        """The score of a choice whose share and cost in bytes are known already."""
        quality = self.knowledge.factors[algorithm] * min(1.0, share)
        value = self.objective.value(quality, cost)
        return Score(participants, algorithm, quality, cost, value)

    def fits(self, score: Score) -> bool:
        """Whether the link can carry the choice at the fusion rate."""
        return score.cost_bytes <= self.budget_bytes

    def good_enough(self, score: Score) -> bool:
        """Q >= Q_min."""
        return score.quality >= self.objective.q_min


def pack_areas(areas: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Area masks, bool (n, G, G), as rows of 64-bit words."""
    packed = np.packbits(areas.reshape(len(areas), -1), axis=1)
    padding = -packed.shape[1] % 8
    return np.ascontiguousarray(np.pad(packed, ((0, 0), (0, padding)))).view(np.uint64)
