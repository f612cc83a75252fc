"""Encoding frames in the form that a fusion algorithm asks for."""

from __future__ import annotations

import time

from perception.fusion.base import EncodeOptions, Fusion
from perception.fusion.registry import make_fusion
from robot_agent.frames import Frame
from robot_agent.metrics import RobotMetrics
from swarm.errors import CoAdaptError, PerceptionError
from swarm.messages import ALGORITHMS


class Encoder:
    """The robot side of every fusion algorithm that exists for a world's detector."""

    def __init__(self, detector: str, metrics: RobotMetrics) -> None:
        self._metrics = metrics
        self._fusions: dict[str, Fusion] = {}
        self._missing: dict[str, str] = {}
        for name in ALGORITHMS:
            try:
                self._fusions[name] = make_fusion(name, detector)
            except CoAdaptError as error:
                self._missing[name] = str(error)

    @property
    def algorithms(self) -> tuple[str, ...]:
        """The algorithms that a frame can be encoded for."""
        return tuple(self._fusions)

    def encode(self, frame: Frame, algorithm: str, options: EncodeOptions) -> bytes:
        """The payload of a frame; the same form of the same frame is encoded once.

        Raises PerceptionError when the algorithm does not exist or the scan cannot be encoded.
        """
        fusion = self._fusions.get(algorithm)
        if fusion is None:
            raise PerceptionError(
                self._missing.get(algorithm)
                or f"algorithm {algorithm!r} is unknown; allowed: {', '.join(self._fusions)}"
            )

        def work() -> bytes:
            begun = time.perf_counter()
            payload = fusion.encode(frame.scan.points, options)
            self._metrics.encode_seconds.labels(algorithm).observe(time.perf_counter() - begun)
            return payload

        return frame.payload((algorithm, options), work)
