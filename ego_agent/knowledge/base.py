"""The shared knowledge of the control cycle: objective, algorithms, measured sizes, past results.

Execute writes from its own thread what it received; Analyze and Plan read. All methods may be
called from any thread.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median

from ego_agent.knowledge.experience import Experience
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.own_costs import OwnCosts
from swarm.errors import DecisionError
from swarm.messages import ALGORITHMS, MAX_MESSAGE_BYTES, Algorithm, Source

PRIOR_FACTORS: Mapping[Algorithm, float] = {"early": 1.0, "intermediate": 0.97, "late": 0.90}
"""Prior f(a): quality of an algorithm relative to merging all points, with everyone taking part.

Early is 1 by definition. AP@0.7 relative to early, with this project's detectors
(docs/perception.md): late 0.92 in the factory and 0.81 on OPV2V's sample; intermediate 0.97 and
1.00, its other forms 0.97 to 0.98 and 0.98 to 1.02. In the published results of CoAdapt, for equal
scenario, frame and participants, late has 0.96 of early (5 pairs) and 0.82 of intermediate (48
pairs).
"""

OTHER_FACTOR = 0.97
"""Of an algorithm that is not listed: other ways to fuse features."""
MAX_SERIES = 4096
"""Receipt series kept at most, one a robot and algorithm; the longest unused is dropped."""


@dataclass(frozen=True, slots=True)
class CycleResult:
    """What came of one decision."""

    cycle: int
    algorithm: Algorithm
    participants: tuple[str, ...]
    source: Source
    quality: float
    """Predicted Q(P, a)."""
    predicted_bytes: int
    """C(P, a), a frame."""
    received_bytes: int
    """All payload bytes that arrived in the cycle."""
    frames: int
    latency_ms: float
    """Median over the cycle's frames, from the first query to the fused boxes."""


class Knowledge:
    """What the stages of the control cycle share.

    Raises DecisionError when there is no algorithm, or one without a quality factor in (0, 1].
    """

    def __init__(
        self,
        objective: Objective | None = None,
        algorithms: Iterable[str] = ALGORITHMS,
        factors: Mapping[Algorithm, float] | None = None,
        *,
        receipts: int = 15,
        receipt_max_age_s: float = 10.0,
        results: int = 256,
        learns: bool = True,
    ) -> None:
        """`algorithms`: those that can be fused, early to late. `learns`: whether decisions heed
        what came of those before."""
        self.learns = learns
        self.experience = Experience()
        """How long robots take to answer."""
        self.own_costs = OwnCosts()
        """What a frame takes the ego itself."""
        self.objective = objective or Objective()
        self.algorithms = tuple(dict.fromkeys(algorithms))
        if not self.algorithms:
            raise DecisionError("no algorithm is available")
        self.factors: dict[Algorithm, float] = {
            name: PRIOR_FACTORS.get(name, OTHER_FACTOR) for name in self.algorithms
        } | dict(factors or {})
        for name in self.algorithms:
            if not 0.0 < self.factors[name] <= 1.0:
                raise DecisionError(
                    f"quality factor of {name} is {self.factors[name]}; it must be in (0, 1]"
                )
        self._receipts = receipts
        self._max_age_ns = int(receipt_max_age_s * 1e9)
        self._lock = threading.Lock()
        self._sizes: OrderedDict[tuple[str, str], deque[tuple[int, int]]] = OrderedDict()
        self._results: deque[CycleResult] = deque(maxlen=results)

    def record_payload(self, robot: str, algorithm: str, size: int, now_ns: int) -> None:
        """Notes the bytes of an observation that arrived at `now_ns` on the ego's clock."""
        key = (robot, algorithm)
        with self._lock:
            series = self._sizes.setdefault(key, deque(maxlen=self._receipts))
            series.append((now_ns, size))
            self._sizes.move_to_end(key)
            if len(self._sizes) > MAX_SERIES:
                self._sizes.popitem(last=False)

    def payload_sizes(
        self, robot: str, announced: Mapping[str, int], now_ns: int
    ) -> dict[Algorithm, int]:
        """Bytes of one observation by algorithm: the median of the receipts of the last seconds,
        else what the robot's beacon announces.

        An algorithm is left out when its size is unknown, 0 (nothing encoded yet) or more than a
        message may hold.
        """
        sizes: dict[Algorithm, int] = {}
        for algorithm in self.algorithms:
            size = self._measured(robot, algorithm, now_ns) or announced.get(algorithm, 0)
            if 0 < size <= MAX_MESSAGE_BYTES:
                sizes[algorithm] = size
        return sizes

    def _measured(self, robot: str, algorithm: Algorithm, now_ns: int) -> int:
        """The median of recent receipts in bytes; 0 when there is none."""
        with self._lock:
            series = tuple(self._sizes.get((robot, algorithm), ()))
        recent = [size for at_ns, size in series if now_ns - at_ns <= self._max_age_ns]
        return round(median(recent)) if recent else 0

    def record_result(self, result: CycleResult) -> None:
        """Notes what came of a decision; the oldest result is dropped when there are too many."""
        with self._lock:
            self._results.append(result)

    def results(self) -> tuple[CycleResult, ...]:
        """Past results, oldest first."""
        with self._lock:
            return tuple(self._results)

    def best_algorithm(self) -> Algorithm:
        """The algorithm with the highest quality factor: what the ego uses alone, for free."""
        return max(self.algorithms, key=lambda name: self.factors[name])
