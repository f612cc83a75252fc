"""Scores of choices in one scene with the surrogate's estimate of Q."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.surrogate.features import SceneFeatures, with_algorithm
from ego_agent.plan.surrogate.model import Surrogate
from swarm.messages import Algorithm

EXHAUSTIVE = 6
"""Candidates of which every set is tried."""
LEAST_GAIN = 1e-3
"""In Q - lambda C, that one more participant must bring."""


class Estimate:
    """Predicts choices in the scorer's scene.

    A score's `quality` is the predicted AP@0.7, its `value` that less lambda C.
    """

    def __init__(self, scorer: Scorer, model: Surrogate) -> None:
        self.scorer = scorer
        self._model = model
        self._features = SceneFeatures(scorer.scene)
        self._names = [candidate.robot for candidate in scorer.scene.candidates]
        self.algorithms = [a for a in scorer.knowledge.algorithms if a in model.algorithms]
        """Those that are available and known to the surrogate."""

    def score(self, participants: Collection[str], algorithm: Algorithm) -> Score:
        """The score of one choice. Raises KeyError where a size is not known, ValueError for an
        algorithm that the surrogate does not know."""
        (score,) = self._scores([self._rows(participants)], [algorithm])
        return score

    def options(self) -> Iterator[Score]:
        """The ego alone, and choices that the link carries: all of them with EXHAUSTIVE candidates
        or fewer, else those on the way of greedy growth by predicted value."""
        yield from self._scores([()], [self.scorer.knowledge.best_algorithm()])
        if len(self._names) <= EXHAUSTIVE:
            yield from self._every()
            return
        for algorithm in self.algorithms:
            yield from self._growing(algorithm)

    def _every(self) -> Iterator[Score]:
        sets, algorithms = [], []
        for algorithm in self.algorithms:
            able = self._able(algorithm)
            for size in range(1, len(able) + 1):
                for rows in combinations(able, size):
                    if self._cost(rows, algorithm) <= self.scorer.budget_bytes:
                        sets.append(rows)
                        algorithms.append(algorithm)
        yield from self._scores(sets, algorithms)

    def _growing(self, algorithm: Algorithm) -> Iterator[Score]:
        able, value = self._able(algorithm), -np.inf
        rows: tuple[int, ...] = ()
        while able:
            sets = [
                tuple(sorted((*rows, row)))
                for row in able
                if self._cost((*rows, row), algorithm) <= self.scorer.budget_bytes
            ]
            scores = list(self._scores(sets, [algorithm] * len(sets)))
            if not scores:
                return
            at = int(np.argmax([score.value for score in scores]))
            if rows and scores[at].value < value + LEAST_GAIN:
                return
            yield scores[at]
            rows, value = sets[at], scores[at].value
            able = [row for row in able if row not in rows]

    def _able(self, algorithm: Algorithm) -> list[int]:
        return [row for row, name in enumerate(self._names, 1) if self.scorer.can(name, algorithm)]

    def _rows(self, participants: Collection[str]) -> tuple[int, ...]:
        return tuple(sorted({self.scorer.row_of[robot] for robot in participants} - {0}))

    def _cost(self, rows: Sequence[int], algorithm: Algorithm) -> int:
        return sum(self.scorer.size(self._names[row - 1], algorithm) for row in rows)

    def _scores(
        self, sets: Sequence[tuple[int, ...]], algorithms: Sequence[Algorithm]
    ) -> Iterator[Score]:
        if not sets:
            return
        precision = self._predict(sets, algorithms)
        arriving = [self._arriving(*choice) for choice in zip(sets, algorithms, strict=True)]
        if min(arriving) < 1.0:
            alone = self._predict([()], [""])[0]
            precision = alone + (precision - alone) * np.array(arriving)
        for rows, algorithm, ap_70 in zip(sets, algorithms, precision.tolist(), strict=True):
            chosen = tuple(self._names[row - 1] for row in rows)
            value = ap_70 - self.scorer.cost(chosen, algorithm)
            cost_bytes = self._cost(rows, algorithm)
            yield Score(chosen, algorithm, ap_70, cost_bytes, value, self.scorer.pace)

    def _arriving(self, rows: tuple[int, ...], algorithm: Algorithm) -> float:
        """The share of the participants that is expected to be in time: as much of what they add
        to the ego alone is counted."""
        return float(self.scorer.arrival(algorithm)[list(rows)].mean()) if rows else 1.0

    def _predict(
        self, sets: Sequence[tuple[int, ...]], algorithms: Sequence[Algorithm]
    ) -> NDArray[np.float64]:
        different = {rows: at for at, rows in enumerate(dict.fromkeys(sets))}
        members = np.zeros((len(different), len(self._names) + 1), dtype=np.bool_)
        for rows, at in different.items():
            members[at, list(rows)] = True
        features = self._features.sets(members)[[different[rows] for rows in sets]]
        used = [name if rows else "" for rows, name in zip(sets, algorithms, strict=True)]
        return self._model.predict(with_algorithm(features, used, self._model.algorithms))
