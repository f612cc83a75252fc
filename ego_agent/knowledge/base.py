"""The shared knowledge of the control cycle: objective, algorithms, measured sizes, past results.

Execute writes from its own thread what it received; Analyze and Plan read. All methods may be
called from any thread.
"""

from __future__ import annotations

import copy
import threading
from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median

from ego_agent.knowledge.compute import SINGLE, Work, packaged_compute
from ego_agent.knowledge.experience import Experience
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.own_costs import OwnCosts
from ego_agent.knowledge.placing import Placing
from ego_agent.knowledge.quality import QualityModel, quality_of
from ego_agent.knowledge.rates import USUAL_DETECTOR, RateModel, rates_of
from swarm.errors import DecisionError
from swarm.messages import ALGORITHMS, MAX_MESSAGE_BYTES, Algorithm, Source

FOCUSED = "+places"
"""What is added to an algorithm's name for answers about places."""
OBJECTS = "+objects"
"""The same for those of what may be an object only."""
NO_WORK = Work(encode_ms=0.0, fixed_ms=0.0, add_ms=0.0)
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


PARTS_AGE_NS = 600 * 10**9
"""How long it is known what robots send that are asked for a part only: one that sends all the same
is not asked so again every few seconds."""


class Knowledge:
    """What the stages of the control cycle share.

    Raises DecisionError when there is no algorithm.
    """

    def __init__(
        self,
        objective: Objective | None = None,
        algorithms: Iterable[str] = ALGORITHMS,
        *,
        quality: QualityModel | None = None,
        works: Mapping[Algorithm, Work] | None = None,
        receipts: int = 15,
        receipt_max_age_s: float = 10.0,
        results: int = 256,
        learns: bool = True,
        shares: bool = True,
        rates: RateModel | None = None,
        mixable: Iterable[str] | None = None,
        remembers: bool = False,
    ) -> None:
        """`algorithms`: those that can be fused, early to late. `quality`: what precision to
        expect, a share where None. `works`: what algorithms take of processors, where nothing was
        measured yet; nothing where None. `learns`: whether decisions heed what came of those
        before. `shares`: whether the ego takes what robots publish for several. `rates`: what rarer
        contributions are worth, USUAL_DETECTOR's where None. `mixable`: algorithms that can be
        fused in one frame, all of them where None. `remembers`: whether `quality` is that of an ego
        that goes by memory."""
        self.learns = learns
        self.shares = shares
        self.experience = Experience()
        """How long robots take to answer."""
        self.own_costs = OwnCosts()
        """What a frame takes the ego itself."""
        self.placing = Placing()
        """How much of what robots send can be laid in its place."""
        self.objective = objective or Objective()
        self.algorithms = tuple(dict.fromkeys(algorithms))
        if not self.algorithms:
            raise DecisionError("no algorithm is available")
        self.quality = quality or QualityModel()
        self.rates = rates or rates_of(USUAL_DETECTOR)
        self._remembers = remembers
        self.mixable = frozenset(self.algorithms if mixable is None else mixable)
        self._works = dict(works or {})
        self._receipts = receipts
        self._max_age_ns = int(receipt_max_age_s * 1e9)
        self._lock = threading.Lock()
        self._sizes: OrderedDict[tuple[str, str], deque[tuple[int, int]]] = OrderedDict()
        self._results: deque[CycleResult] = deque(maxlen=results)

    @classmethod
    def of_detector(
        cls,
        detector: str,
        objective: Objective | None = None,
        algorithms: Iterable[str] = ALGORITHMS,
        *,
        learns: bool = True,
        shares: bool = True,
        mixable: Iterable[str] | None = None,
    ) -> Knowledge:
        """Of an ego with that detector: its quality model, and what its algorithms take of
        processors. Where it has none, Q is a share and work costs nothing until it is measured."""
        works = packaged_compute().detectors.get(detector)
        remembers = objective is not None and bool(objective.rarer_hz)
        quality = quality_of(detector, remembers=remembers)
        return cls(
            objective,
            algorithms,
            quality=quality,
            works=works,
            learns=learns,
            shares=shares,
            rates=rates_of(detector),
            mixable=mixable,
            remembers=remembers,
        )

    def may_be_rarer(self, algorithm: Algorithm) -> bool:
        """Whether robots may be asked for it less often than frames are fused."""
        return bool(self.objective.rarer_hz) and algorithm in self.mixable

    def aiming_at(self, objective: Objective) -> Knowledge:
        """The same knowledge, which goes on growing, with another objective."""
        other = copy.copy(self)
        other.objective = objective
        return other

    def places_hz(self, algorithm: Algorithm, rate_hz: float) -> float:
        """How often who sends it at that rate is asked about places in between; 0: never."""
        if not self.may_be_rarer(algorithm):
            return 0.0
        return min(self.objective.places_hz, self.rates.between_hz(algorithm, rate_hz))

    def record_payload(
        self,
        robot: str,
        algorithm: str,
        size: int,
        now_ns: int,
        *,
        focused: bool = False,
        objects_only: bool = False,
    ) -> None:
        """Notes the bytes of an observation that arrived at `now_ns` on the ego's clock; `focused`:
        of an answer about places, with those that say which; `objects_only`: of what may be an
        object."""
        key = (robot, algorithm + (FOCUSED if focused else OBJECTS if objects_only else ""))
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
            measured = self._measured(robot, algorithm, now_ns, self._max_age_ns)
            size = measured or announced.get(algorithm, 0)
            if 0 < size <= MAX_MESSAGE_BYTES:
                sizes[algorithm] = size
        return sizes

    def focused_sizes(self, robot: str, now_ns: int) -> dict[Algorithm, int]:
        """Bytes of one answer about places, by algorithm: the median of the receipts of the last
        seconds, else of the last PARTS_AGE_NS. Those of which nothing came are left out."""
        return self._sizes_of_part(robot, FOCUSED, now_ns)

    def object_sizes(self, robot: str, now_ns: int) -> dict[Algorithm, int]:
        """The same of what may be an object."""
        return self._sizes_of_part(robot, OBJECTS, now_ns)

    def _sizes_of_part(self, robot: str, part: str, now_ns: int) -> dict[Algorithm, int]:
        sizes = {}
        for name in self.algorithms:
            for max_age_ns in (self._max_age_ns, PARTS_AGE_NS):
                size = self._measured(robot, name + part, now_ns, max_age_ns)
                if size:
                    sizes[name] = size
                    break
        return sizes

    def _measured(self, robot: str, algorithm: str, now_ns: int, max_age_ns: int) -> int:
        """The median of receipts that are no older, in bytes; 0 when there is none."""
        with self._lock:
            series = tuple(self._sizes.get((robot, algorithm), ()))
        # Of a clock that was put back nothing is recent.
        recent = [size for at_ns, size in series if 0 <= now_ns - at_ns <= max_age_ns]
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
        """The algorithm that gains most of what participants show: what the ego uses alone, for
        free."""
        return max(self.algorithms, key=self.quality.gain)

    def convinces(self, algorithm: Algorithm) -> float:
        """Probability that what one robot shows in time suffices, in [0, 1]; 1 where frames stand
        for themselves, as their quality model has it."""
        return self.rates.convinces(algorithm) if self._remembers else 1.0

    def encode_s(self, algorithm: Algorithm, measured_s: float | None) -> float:
        """Seconds of a robot's processor that one observation takes: as its answers told, else as
        usual."""
        if measured_s is not None:
            return measured_s
        return self._works.get(algorithm, NO_WORK).encode_ms * 1e-3

    def fixed_s(self) -> float:
        """Seconds of the ego's processor that a fused frame takes, whoever takes part: as
        usual."""
        return self._works.get(SINGLE, NO_WORK).fixed_ms * 1e-3

    def add_s(self, algorithm: Algorithm) -> float:
        """Seconds for which taking one contribution up keeps the ego busy, on the machine as it is:
        as measured, else as usual."""
        return self._adds(algorithm, self.own_costs.add_s(algorithm))

    def work_s(self, algorithm: Algorithm) -> float:
        """Seconds of the ego's processor that this takes, its price: as measured, else as usual."""
        return self._adds(algorithm, self.own_costs.work_s(algorithm))

    def _adds(self, algorithm: Algorithm, measured_s: float | None) -> float:
        if self.learns and measured_s is not None:
            return measured_s
        return self._works.get(algorithm, NO_WORK).add_ms * 1e-3
