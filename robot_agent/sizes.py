"""What an observation of each algorithm costs, for beacons: from answers where there are any."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np

from perception.codec.boxes import encode_boxes
from perception.codec.outlined import add_outline, take_outline
from perception.detector.grid import bev_config
from perception.fusion.algorithms.late import SENT_BOXES
from perception.types import Boxes

BOUNDED = "late"
"""Its payload is an outline and at most SENT_BOXES boxes: no need to run the detector only to know
how large that is."""


class Sizes:
    """Payload bytes by algorithm; safe to use from several threads. Times are `time.monotonic()`
    seconds."""

    def __init__(self, detector: str, algorithms: Sequence[str], period_s: float) -> None:
        """`algorithms` are those announced, each with a size that is `period_s` old at most."""
        self._algorithms = tuple(algorithms)
        self._period_s = period_s
        self._labels = bev_config(detector).labels
        self._lock = threading.Lock()
        self._bytes: dict[str, int] = {}
        self._learnt_at: dict[str, float] = {}

    def known(self) -> dict[str, int]:
        """The sizes so far."""
        with self._lock:
            return dict(self._bytes)

    def overdue(self, now: float) -> str | None:
        """The announced algorithm whose size was learnt longest ago, and too long ago or never."""
        with self._lock:
            oldest = min(self._algorithms, key=self._age_key, default=None)
            return oldest if oldest is not None and self._is_old(oldest, now) else None

    def note(self, algorithm: str, payload: bytes, now: float) -> None:
        """Learns from a payload: the size of its algorithm, and through its outline a bound of
        `late` where that was not sent of late."""
        with self._lock:
            self._set(algorithm, len(payload), now)
            if algorithm != BOUNDED and self._is_old(BOUNDED, now):
                self._set(BOUNDED, self._bound(payload), now)

    def forget(self, algorithm: str, now: float) -> None:
        """The algorithm's encoder fails: no size until it works again."""
        with self._lock:
            self._bytes.pop(algorithm, None)
            self._learnt_at[algorithm] = now

    def _set(self, algorithm: str, size: int, now: float) -> None:
        if algorithm in self._algorithms:
            self._bytes[algorithm] = size
            self._learnt_at[algorithm] = now

    def _age_key(self, algorithm: str) -> float:
        return self._learnt_at.get(algorithm, float("-inf"))

    def _is_old(self, algorithm: str, now: float) -> bool:
        return now - self._age_key(algorithm) >= self._period_s

    def _bound(self, payload: bytes) -> int:
        """Bytes of as many boxes as are ever sent, with the outline of another payload."""
        labels = (self._labels * SENT_BOXES)[:SENT_BOXES]
        places, zeros = np.zeros((SENT_BOXES, 3)), np.zeros(SENT_BOXES)
        boxes = encode_boxes(Boxes(places, places, zeros, zeros, labels))
        return len(add_outline(boxes, take_outline(payload)[1]))
