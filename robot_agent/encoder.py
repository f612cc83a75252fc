"""Encoding frames in the form that a fusion algorithm asks for."""

from __future__ import annotations

from collections.abc import Sequence

from perception.fusion.base import EncodeOptions
from perception.fusion.registry import fusion_names, make_fusion
from robot_agent.frames import Encoded, Frame
from robot_agent.metrics import RobotMetrics
from robot_agent.stopwatch import Stopwatch


class Encoder:
    """The robot side of every fusion algorithm there is, for one world's detector."""

    def __init__(self, detector: str, metrics: RobotMetrics, measured: Sequence[str] = ()) -> None:
        """`measured`: the algorithms that beacons announce sizes of, of those that are available;
        all where none is named."""
        self._detector = detector
        self._metrics = metrics
        self._fusions = {name: make_fusion(name, detector) for name in fusion_names(detector)}
        self._measured = tuple(n for n in self._fusions if n in measured or not measured)

    @property
    def algorithms(self) -> tuple[str, ...]:
        """The algorithms whose sizes are announced."""
        return self._measured

    def shareable(self, algorithm: str) -> bool:
        """Whether several egos can use one payload of an algorithm."""
        fusion = self._fusions.get(algorithm)
        return fusion is not None and fusion.shareable

    def focuses(self, algorithm: str) -> bool:
        """Whether what is sent of a scan may be what lies in places that the ego asks about."""
        fusion = self._fusions.get(algorithm)
        return fusion is not None and fusion.focuses

    def encode(self, frame: Frame, algorithm: str, options: EncodeOptions) -> Encoded:
        """The payload of a frame; the same form of the same frame is encoded once.

        Raises PerceptionError when the algorithm does not exist or the scan cannot be encoded.
        """
        # An algorithm that is not there: making it says why.
        fusion = self._fusions.get(algorithm) or make_fusion(algorithm, self._detector)

        def work() -> Encoded:
            watch = Stopwatch()
            payload = fusion.encode(frame.scan.points, options)
            self._metrics.encode_seconds.labels(algorithm).observe(watch.passed_ms() * 1e-3)
            return Encoded(payload, watch.worked_ms())

        return frame.payload((algorithm, options), work)
